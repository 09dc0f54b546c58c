"""Matches the columns of a table with a study's parameters, and derives parameters from columns.

Headers are compared without regard to case, blanks and a unit in brackets. A column that is none of
a study's is left aside.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

FILE_COLUMN: Final = "file"
SCORE_COLUMN: Final = "score"
VIDEO_ENDINGS: Final = (
    ".mp4", ".m4v", ".mov", ".webm", ".ogv", ".ogg", ".avi", ".mkv", ".mpg", ".mpeg", ".wmv", ".gif"
)  # fmt: skip
#: Other names that people give to the column of files.
_NAMES_OF_FILE_COLUMNS: Final = """
    file filename file_name filepath file_path path video videos videofile video_file video_name
    videoname video_path clip clip_file recording recording_file movie datei dateiname videodatei
    fichier archivo ファイル ファイル名 動画 動画ファイル ビデオ 映像
"""
_SCORE_KEYS: Final = frozenset({"score", "scores", "punkte", "スコア"})
#: Columns that number the rows or say something of the recording, and are no parameters.
_NAMES_OF_NOTES: Final = """
    id ids index idx no nr num number row run trial # date time datetime timestamp day note notes
    comment comments remark remarks description who by operator filmed_by recorded_by camera take
    datum uhrzeit notiz notizen bemerkung bemerkungen kommentar nummer lfd_nr 番号 備考 日付 メモ
"""
_FILE_KEYS: Final = frozenset(_NAMES_OF_FILE_COLUMNS.split())
_ASIDE_KEYS: Final = frozenset(_NAMES_OF_NOTES.split())
_UNIT: Final = re.compile(r"(.*?)\s*(?:\[([^\[\]]+)\]|\(([^()]+)\))\s*")
#: As in DIN 461: `v / (m/s)` or `t / s`.
_DIVIDED: Final = re.compile(r"(.*?\S)\s+/\s+\(?([^()]+?)\)?\s*")
_LETTERS: Final = {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"}
LONGEST_NAME: Final = 40


@dataclass(frozen=True)
class Wanted:
    """A parameter to find: its name, and its labels in all languages."""

    name: str
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Columns:
    """The places of a study's columns in a header. aside: the names of the other columns."""

    parameters: tuple[int, ...]
    file: int
    score: int | None
    aside: tuple[str, ...]


class UnmatchedColumnsError(Exception):
    """A header without the columns of the study; `problems` has a sentence for each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


def label_and_unit(header: str) -> tuple[str, str | None]:
    """A header's words and its unit: `speed [rev/s]` has `speed` and `rev/s`."""
    # Brackets of full width become plain ones.
    header = unicodedata.normalize("NFKC", header)
    found = _UNIT.fullmatch(header)
    if found is not None and found[1]:
        return found[1].strip(), next(filter(None, found.groups()[1:])).strip()
    divided = _DIVIDED.fullmatch(header)
    if divided is not None:
        return divided[1].strip(), divided[2].strip()
    return header.strip(), None


def key(header: str) -> str:
    """What headers are compared by: letters and digits in lower case, without a unit."""
    words = label_and_unit(header)[0].casefold()
    return re.sub(r"[\W_]+", "_", words).strip("_") or words.strip()


def looks_like_header(cells: Iterable[str]) -> bool:
    """Whether one of the cells is a name of the column of files."""
    return any(key(cell) in _FILE_KEYS for cell in cells)


def names_a_video(cell: str) -> bool:
    """Whether the cell ends as names of videos do."""
    return cell.strip().casefold().endswith(VIDEO_ENDINGS)


def match(
    header: Sequence[str], rows: Sequence[Sequence[str]], parameters: Sequence[Wanted]
) -> Columns:
    """The columns of these parameters, of the files and of the scores.

    Raises UnmatchedColumnsError if one is missing, or if more than one column can be meant.
    """
    came = ", ".join(name or "(no name)" for name in header)
    problems: list[str] = []
    places: list[int] = []
    wanted = [(one.name, {key(one.name), *map(key, one.labels)}) for one in parameters]
    for name, keys in wanted:
        place = _only(header, name, keys, problems)
        if place is None:
            problems.append(f"expected a column {name}, got {came}")
        places.append(-1 if place is None else place)
    file = _file_column(header, rows, set(places), problems)
    if file is None:
        problems.append(f"expected a column {FILE_COLUMN}, got {came}")
    score = _only(header, SCORE_COLUMN, set(_SCORE_KEYS), problems)
    if problems or file is None:
        raise UnmatchedColumnsError(list(dict.fromkeys(problems)))
    used = {*places, file, score}
    aside = [name for place, name in enumerate(header) if place not in used]
    return Columns(tuple(places), file, score, tuple(aside))


def _only(header: Sequence[str], name: str, keys: set[str], problems: list[str]) -> int | None:
    """The column of exactly this name, or else the one with one of these keys."""
    exact = [place for place, came in enumerate(header) if came == name]
    if len(exact) > 1:
        problems.append(f"expected each column once, got {name} {len(exact)} times")
        return exact[0]
    found = exact or [place for place, came in enumerate(header) if key(came) in keys]
    if len(found) > 1:
        names = " and ".join(header[place] for place in found)
        problems.append(f"expected one column for {name}, got {names}: rename one of them")
    return found[0] if found else None


def _file_column(
    header: Sequence[str], rows: Sequence[Sequence[str]], taken: set[int], problems: list[str]
) -> int | None:
    if FILE_COLUMN in header or len({key(name) for name in header} & _FILE_KEYS) == 1:
        return _only(header, FILE_COLUMN, set(_FILE_KEYS), problems)
    found = [
        place
        for place in range(len(header))
        if place not in taken and any(names_a_video(row[place]) for row in rows if place < len(row))
    ]
    if len(found) > 1:
        names = " and ".join(header[place] or "(no name)" for place in found)
        problems.append(f"expected one column for {FILE_COLUMN}, got {names}: rename one of them")
    return found[0] if found else None


def is_aside(header: str) -> bool:
    """Whether a column of this name numbers or describes recordings and is no parameter."""
    return not header or key(header) in _ASIDE_KEYS or header.casefold().startswith("unnamed:")


def parameter_name(header: str, taken: Iterable[str]) -> str:
    """A name for a parameter out of a header: `Höhe (m)` becomes `hoehe`; unlike those taken."""
    words = label_and_unit(header)[0].casefold()
    words = "".join(_LETTERS.get(letter, letter) for letter in unicodedata.normalize("NFC", words))
    plain = unicodedata.normalize("NFKD", words).encode("ascii", "ignore").decode()
    name = re.sub(r"[^a-z0-9]+", "_", plain).strip("_")[: LONGEST_NAME - 4].strip("_")
    if not name or not name[0].isalpha():
        name = f"parameter_{name}".strip("_")
    used = set(taken)
    return next(
        one
        for one in (name, *(f"{name}_{number}" for number in range(2, 10_000)))
        if one not in used
    )
