"""A fault in a study folder, and the exception that carries all of them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from .shortening import shortened

_TOLD = re.compile(
    r"(?:(?P<place>[^:]*[^:\s]): )?(?P<before>.*?)expected (?P<expected>.*?)"
    r"(?:, (?:got|and there) (?P<got>.*)|, (?P<rest>there is .*))?",
    re.DOTALL,
)


#: A message repeats what came, and that may be a whole file.
LONGEST_MESSAGE = 1_000


@dataclass(frozen=True)
class FaultParts:
    """The parts of a fault's message: where in the line, what was expected, and what came."""

    place: str
    expected: str
    got: str


@dataclass(frozen=True)
class Fault:
    """What is wrong, and where: `file` is relative to the study folder, `line` counts from 1.

    `line` is None where the fault is not in one line (a file that is missing or empty). `cause` is
    equal for faults of a file that have one cause, such as every number with a comma in a column.
    """

    file: str
    line: int | None
    message: str
    cause: str = ""

    def __post_init__(self) -> None:
        if len(self.message) > LONGEST_MESSAGE:
            half = LONGEST_MESSAGE // 2
            short = f"{self.message[:half]} ... {self.message[-half:]}"
            object.__setattr__(self, "message", short)

    @property
    def parts(self) -> FaultParts:
        """The parts of the message; a message of another form counts as what came."""
        found = _TOLD.fullmatch(self.message)
        if found is None:
            return FaultParts("", "", self.message)
        before = found["before"].rstrip(", ")
        got = found["got"] or found["rest"] or ""
        return FaultParts(
            found["place"] or "", found["expected"], " ".join(filter(None, (before, got)))
        )

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {self.message}"


#: Faults of one cause that are named one by one; of the others their number is given.
NAMED_OF_A_CAUSE = 3


@dataclass(frozen=True)
class FaultGroup:
    """The faults of a file that have one cause: the first few, and the lines of the others."""

    shown: tuple[Fault, ...]
    lines: tuple[int, ...] = ()

    @property
    def more(self) -> str:
        """A sentence on the faults that are not shown; empty if all are."""
        if not self.lines:
            return ""
        if len(self.lines) == 1:
            return f"and 1 more of this kind, in line {self.lines[0]}"
        first, last = self.lines[0], self.lines[-1]
        return f"and {len(self.lines):,} more of this kind, in lines {first} to {last}"


def grouped(faults: Sequence[Fault]) -> list[FaultGroup]:
    """The faults by file and cause, in the order of the first of each."""
    found: dict[tuple[str, str], list[Fault]] = {}
    for place, fault in enumerate(faults):
        cause = fault.cause or f"{place} {fault.message}"
        found.setdefault((fault.file, cause), []).append(fault)
    return [
        FaultGroup(
            tuple(group[:NAMED_OF_A_CAUSE]),
            tuple(fault.line or 1 for fault in group[NAMED_OF_A_CAUSE:]),
        )
        for group in found.values()
    ]


def in_lines(faults: Sequence[Fault]) -> list[str]:
    """The faults as text, a line each, grouped by cause."""
    lines: list[str] = []
    for group in grouped(faults):
        lines.extend(map(str, group.shown))
        if group.more:
            lines.append(f"{group.shown[0].file}: {group.more}")
    return lines


class StudyFaults(Exception):  # noqa: N818 - it is its faults, one or more
    """A study folder with faults; the message has a line for each, or for many of one cause."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        # A file can hold one value of a million characters: a fault repeats the beginning of it.
        self.faults = tuple(replace(fault, message=shortened(fault.message)) for fault in faults)
        super().__init__("\n".join(in_lines(self.faults)))


class UnreadableFileError(Exception):
    """A file that cannot be read as text; the message says why, `line` where."""

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line
