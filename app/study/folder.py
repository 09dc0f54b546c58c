"""Reads and validates a study folder: `study.yaml`, texts per language, and recordings."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from app.video.decoder_client import Decoder

from .attention_candidates import missing_for_checks
from .files import is_file, misplaced, read_text
from .markdown import placeholders
from .parsed_plan import Inconsistency
from .plan import LANGUAGE_PATTERN, Plan
from .plan_source import STUDY_FILE, PlanReading, SettingsCheck, read_plan
from .plan_validation import parameter_names
from .recordings import RecordingRow, RecordingsReader, candidates_of
from .validation_errors import Fault, StudyFaults, UnreadableFileError

TEXT_NAMES = ("consent", "instructions", "debrief")
#: Optional text before the consent; a study that has it needs it in every language.
WELCOME = "welcome"

_SHIPPED_FOLDER = Path(__file__).parent / "shipped"
SHIPPED: Mapping[str, Path] = MappingProxyType(
    {
        name: _SHIPPED_FOLDER / name
        for name in ("waste-crane", "waste-crane-env2", "waste-crane-paper")
    }
)


@dataclass(frozen=True)
class StudyFolder:
    """A valid study folder.

    texts: language -> name (consent, instructions, debrief, and welcome if it has one) -> Markdown.
    recordings: the rows of all CSV files, in their order; none for the crane's environments.
    """

    root: Path
    plan: Plan
    texts: Mapping[str, Mapping[str, str]]
    recordings: tuple[RecordingRow, ...]
    #: What does no harm in its videos, and is worth knowing.
    remarks: tuple[Fault, ...] = ()

    def candidates(self, environment: str) -> tuple[tuple[float, ...], ...]:
        """The different candidates of an environment of the study's own, in the CSV's order."""
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


def load(
    folder: Path,
    *,
    settings_check: SettingsCheck | None = None,
    crane_candidates: Callable[[str], Iterable[Sequence[float]]] | None = None,
) -> StudyFolder:
    """Read a study folder. Raises StudyFaults with every fault in it.

    settings_check: returns what is wrong with a condition's settings, or None.
    crane_candidates: returns the candidates of an environment of the crane, to validate those of
        attention checks.
    """
    try:
        text = read_text(folder, folder / STUDY_FILE)
    except UnreadableFileError as error:
        raise StudyFaults([Fault(STUDY_FILE, error.line, str(error))]) from error
    reading = read_plan(text, settings_check)
    texts, text_faults = _read_texts(folder, _languages(reading))
    recordings, recording_faults, remarks = _read_recordings(folder, reading)
    faults = [*reading.faults, *text_faults, *recording_faults]
    if not faults and reading.plan is not None:
        faults = _check_faults(reading, reading.plan, recordings, crane_candidates)
    if faults or reading.plan is None:
        raise StudyFaults(faults)
    return StudyFolder(folder, reading.plan, texts, tuple(recordings), tuple(remarks))


def _check_faults(
    reading: PlanReading,
    plan: Plan,
    rows: Sequence[RecordingRow],
    crane_candidates: Callable[[str], Iterable[Sequence[float]]] | None,
) -> list[Fault]:
    """What the attention checks lack, in every environment that is used."""
    found: list[Inconsistency] = []
    for name in plan.used_environments:
        is_crane = plan.environments[name].is_crane
        if is_crane and crane_candidates is None:
            continue
        candidates = crane_candidates(name) if is_crane and crane_candidates else ()
        own = [row for row in rows if row.environment == name]
        scored = None if is_crane else [row.candidate for row in own if row.score is not None]
        points = list(candidates) if is_crane else [row.candidate for row in own]
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
        for name in names:
            file = f"texts/{language}/{name}.md"
            try:
                text = read_text(folder, folder / file)
            except UnreadableFileError as error:
                faults.append(Fault(file, error.line, str(error)))
                continue
            faults.extend(text_faults(file, text))
            texts[language][name] = text
    return texts, faults


def text_faults(file: str, text: str) -> Iterator[Fault]:
    """Placeholders that remain in a text."""
    if not text.strip():
        yield Fault(file, None, "expected some text, got an empty file")
    for line, placeholder in placeholders(text):
        yield Fault(file, line, f"expected words of your own, got the placeholder {placeholder}")


def _read_recordings(
    folder: Path, reading: PlanReading
) -> tuple[list[RecordingRow], list[Fault], list[Fault]]:
    """The rows, the faults, and the remarks."""
    environments = reading.data.get("environments")
    if not isinstance(environments, dict):
        return [], [], []
    names = parameter_names(reading.data)
    # If a parameter has no valid name, missing columns cannot be determined.
    parameters = [name for name in names if isinstance(name, str)]
    parameters = parameters if len(parameters) == len(names) else []
    with Decoder() as decoder:
        reader = RecordingsReader(folder, decoder)
        rows = _rows(reader, environments, parameters)
    return rows, reader.faults, reader.remarks


def _rows(
    reader: RecordingsReader, environments: Mapping[str, object], parameters: Sequence[str]
) -> list[RecordingRow]:
    rows: list[RecordingRow] = []
    sources: set[str] = set()
    for name, environment in environments.items():
        source = environment.get("source") if isinstance(environment, dict) else None
        if not isinstance(source, str) or not source.endswith(".csv") or source in sources:
            continue
        if misplaced(source) is not None:
            continue
        sources.add(source)
        rows.extend(reader.read(name, source, parameters))
    return rows
