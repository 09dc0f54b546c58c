"""Reads and validates a study folder: `study.yaml`, texts per language, and recordings."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from app.video.decoder_client import Decoder

from .attention_candidates import missing_for_checks
from .file_lookup import MOST_FILES
from .files import is_file, misplaced, read_text
from .page_words import WORDS, words_faults, words_remarks
from .parsed_plan import Inconsistency, as_list, as_mapping
from .placeholders import VALUES, filled, placeholders, unknown_values
from .plan import LANGUAGE_PATTERN, Plan
from .plan_source import STUDY_FILE, PlanReading, SettingsCheck, SpaceCheck, read_plan
from .recordings import ParameterColumn, RecordingRow, RecordingsReader, Value, candidates_of
from .tables import TABLE_ENDINGS
from .validation_errors import Fault, StudyFaults, UnreadableFileError

TEXT_NAMES = ("consent", "instructions", "debrief")
#: Optional text before the consent; a study that has it needs it in every language.
WELCOME = "welcome"
WORDS_MISSING = "expected words of your own"
#: The cause of faults that are placeholders of the example begins so: they are work to do.
PLACEHOLDER_CAUSE = "placeholder "

_SHIPPED_FOLDER = Path(__file__).parent / "shipped"
SHIPPED: Mapping[str, Path] = MappingProxyType(
    {
        name: _SHIPPED_FOLDER / name
        for name in (
            "waste-crane",
            "waste-crane-env2",
            "waste-crane-live",
            "waste-crane-crowd",
            "waste-crane-paper",
        )
    }
)


@dataclass(frozen=True)
class StudyFolder:
    """A valid study folder.

    texts: language -> name (consent, instructions, debrief, and welcome if it has one) -> Markdown;
        name `words` -> the .po file of the pages' words, if it has one.
    recordings: the rows of all tables, in their order; none for the crane's environments and those
        of machines.
    """

    root: Path
    plan: Plan
    texts: Mapping[str, Mapping[str, str]]
    recordings: tuple[RecordingRow, ...]
    #: How its tables were understood, and what does no harm in its videos and is worth knowing.
    remarks: tuple[Fault, ...] = ()
    #: Files in the folder that no part of the study names.
    unused: tuple[str, ...] = ()

    def candidates(self, environment: str) -> tuple[tuple[Value, ...], ...]:
        """The different candidates of an environment of the study's own, in the table's order."""
        return candidates_of(self.recordings, environment)


class UnknownStudyError(Exception):
    """The name is neither a shipped study nor a folder on disk."""


def resolve(name_or_path: str) -> Path:
    """The folder of a shipped study by its name, or any folder by its path."""
    if name_or_path in SHIPPED:
        return SHIPPED[name_or_path]
    path = Path(name_or_path)
    if not path.is_dir():
        shipped = ", ".join(SHIPPED)
        raise UnknownStudyError(
            f"expected a study folder or a shipped study ({shipped}), got {name_or_path!r}"
        )
    return path


@dataclass(frozen=True)
class Examination:
    """What a check of a study folder finds.

    study: None if there are faults. remarks: how tables were understood, and what is worth knowing
    of the videos. unused: files that no part of the study names. sources: the tables that were
    read, by the name that the plan gives them. can_mend: whether slips of YAML can be put right.
    """

    study: StudyFolder | None
    faults: tuple[Fault, ...] = ()
    remarks: tuple[Fault, ...] = ()
    unused: tuple[str, ...] = ()
    data: Mapping[str, object] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)
    can_mend: bool = False


def load(
    folder: Path,
    *,
    settings_check: SettingsCheck | None = None,
    space_check: SpaceCheck | None = None,
    crane_candidates: Callable[[str], Iterable[Sequence[float]]] | None = None,
) -> StudyFolder:
    """Read a study folder. Raises StudyFaults with every fault in it; arguments as of `examine`."""
    found = examine(
        folder,
        settings_check=settings_check,
        space_check=space_check,
        crane_candidates=crane_candidates,
    )
    if found.study is None:
        raise StudyFaults(found.faults)
    return found.study


def examine(
    folder: Path,
    *,
    settings_check: SettingsCheck | None = None,
    space_check: SpaceCheck | None = None,
    crane_candidates: Callable[[str], Iterable[Sequence[float]]] | None = None,
) -> Examination:
    """Check a study folder.

    settings_check: returns what is wrong with a condition's settings, or None.
    space_check: returns what is wrong with the search space of a study over ranges.
    crane_candidates: returns the candidates of an environment of the crane, to validate those of
        attention checks.
    """
    try:
        text = read_text(folder, folder / STUDY_FILE)
    except UnreadableFileError as error:
        fault = Fault(STUDY_FILE, error.line, str(error))
        return Examination(None, (fault,), unused=unused_files(folder, {STUDY_FILE}))
    reading = read_plan(text, settings_check, space_check)
    texts, text_faults = _read_texts(folder, _languages(reading))
    recordings, reader = _read_recordings(folder, reading)
    faults = [*reading.faults, *text_faults, *reader.faults]
    if not faults and reading.plan is not None:
        faults = _check_faults(reading, reading.plan, recordings, crane_candidates)
    used = {STUDY_FILE, *reader.named, *reader.sources.values()}
    used |= {text_path(language, name) for language, named in texts.items() for name in named}
    used |= {fault.file for fault in faults}
    unused = unused_files(folder, used)
    remarks = (*reader.remarks, *_words_remarks(texts, faults))
    study = None
    if not faults and reading.plan is not None:
        plan = reading.plan
        texts = {
            language: {name: filled(text, plan) for name, text in named.items()}
            for language, named in texts.items()
        }
        study = StudyFolder(folder, plan, texts, tuple(recordings), remarks, unused)
    can_mend = bool(reading.slips)
    return Examination(
        study, tuple(faults), remarks, unused, reading.data, reader.sources, can_mend
    )


def text_path(language: str, name: str) -> str:
    """Where in a folder a text is: Markdown, but for the catalogue of the pages' words."""
    return f"texts/{language}/{name}.{'po' if name == WORDS else 'md'}"


def _words_remarks(
    texts: Mapping[str, Mapping[str, str]], faults: Iterable[Fault]
) -> Iterator[Fault]:
    """What is worth knowing of the pages' words, in the languages in which they can be read."""
    faulty = {fault.file for fault in faults}
    for language, named in texts.items():
        if text_path(language, WORDS) not in faulty:
            yield from words_remarks(language, named.get(WORDS))


def unused_files(folder: Path, used: set[str]) -> tuple[str, ...]:
    """The files in the folder that are not among those used, without hidden ones and a README."""
    found = []
    for path in sorted(folder.rglob("*"))[:MOST_FILES]:
        place = path.relative_to(folder)
        hidden = any(part.startswith(".") for part in place.parts)
        is_readme = len(place.parts) == 1 and path.stem.lower() == "readme"
        if not hidden and not is_readme and place.as_posix() not in used and is_file(path):
            found.append(place.as_posix())
    return tuple(found)


def _check_faults(
    reading: PlanReading,
    plan: Plan,
    rows: Sequence[RecordingRow],
    crane_candidates: Callable[[str], Iterable[Sequence[float]]] | None,
) -> list[Fault]:
    """What the attention checks lack, in every environment that is used."""
    found: list[Inconsistency] = []
    for name in plan.used_environments:
        if plan.environments[name].is_machine:
            continue
        is_crane = plan.environments[name].is_crane
        if is_crane and crane_candidates is None:
            continue
        candidates = crane_candidates(name) if is_crane and crane_candidates else ()
        own = [row for row in rows if row.environment == name]
        scored = None if is_crane else [row.candidate for row in own if row.score is not None]
        points = [tuple(one) for one in candidates] if is_crane else [row.candidate for row in own]
        found.extend(missing_for_checks(plan, name, points, scored))
    line = reading.lines.line if reading.lines else lambda _: None
    return [Fault(STUDY_FILE, line(one.place), str(one)) for one in found]


def _languages(reading: PlanReading) -> list[str]:
    """The valid languages: their texts are checked even if the plan has faults."""
    languages = reading.data.get("languages")
    return [
        language
        for language in dict.fromkeys(map(str, languages if isinstance(languages, list) else []))
        if re.fullmatch(LANGUAGE_PATTERN, language)
    ]


def _read_texts(
    folder: Path, languages: Sequence[str]
) -> tuple[dict[str, dict[str, str]], list[Fault]]:
    texts: dict[str, dict[str, str]] = {language: {} for language in languages}
    faults: list[Fault] = []
    names: tuple[str, ...] = TEXT_NAMES
    if any(is_file(folder / f"texts/{language}/{WELCOME}.md") for language in languages):
        names = (WELCOME, *TEXT_NAMES)
    for language in languages:
        own_words = (WORDS,) if is_file(folder / text_path(language, WORDS)) else ()
        for name in (*names, *own_words):
            file = text_path(language, name)
            try:
                text = read_text(folder, folder / file)
            except UnreadableFileError as error:
                faults.append(Fault(file, error.line, str(error)))
                continue
            faults.extend(text_faults(language, name, text))
            texts[language][name] = text
    return texts, faults


def text_faults(language: str, name: str, text: str) -> Iterator[Fault]:
    """Placeholders that remain in a text, and values in it that no plan has.

    Of the pages' words: what keeps them from being used.
    """
    file = text_path(language, name)
    if name == WORDS:
        yield from words_faults(language, text)
        return
    if not text.strip():
        yield Fault(file, None, "expected some text, got an empty file")
    for line, placeholder in placeholders(text):
        message = f"{WORDS_MISSING}, got the placeholder {placeholder}"
        yield Fault(file, line, message, PLACEHOLDER_CAUSE + placeholder)
    for line, value in unknown_values(text):
        known = ", ".join(VALUES)
        yield Fault(file, line, f"expected one of {known} in braces, got {{{{ {value} }}}}")


def _read_recordings(
    folder: Path, reading: PlanReading
) -> tuple[list[RecordingRow], RecordingsReader]:
    """The rows, and the reader with its faults and remarks."""
    environments = as_mapping(reading.data.get("environments"))
    parameters = parameter_columns(reading.data)
    with Decoder() as decoder:
        reader = RecordingsReader(folder, decoder)
        return _rows(reader, environments, parameters), reader


def parameter_columns(data: Mapping[str, object]) -> list[ParameterColumn]:
    """The parameters of a plan that may have faults; none if one of them has no valid name.

    Without valid names, missing columns cannot be determined.
    """
    found = []
    for parameter in map(as_mapping, as_list(data.get("parameters"))):
        name, label, unit = parameter.get("name"), parameter.get("label"), parameter.get("unit")
        if not isinstance(name, str):
            return []
        labels = [label] if isinstance(label, str) else list(as_mapping(label).values())
        found.append(
            ParameterColumn(
                name,
                tuple(one for one in labels if isinstance(one, str)),
                unit if isinstance(unit, str) else None,
                tuple(one for one in as_list(parameter.get("values")) if isinstance(one, str)),
            )
        )
    return found


def _rows(
    reader: RecordingsReader,
    environments: Mapping[str, object],
    parameters: Sequence[ParameterColumn],
) -> list[RecordingRow]:
    rows: list[RecordingRow] = []
    for name, environment in environments.items():
        source = environment.get("source") if isinstance(environment, dict) else None
        if not isinstance(source, str) or not source.lower().endswith(TABLE_ENDINGS):
            continue
        if source in reader.sources or misplaced(source) is not None:
            continue
        rows.extend(reader.read(name, source, parameters))
    return rows
