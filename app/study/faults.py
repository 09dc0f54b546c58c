"""A fault in a study folder, and the error that brings all of them at once."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """What is wrong, and where: `file` is relative to the study folder, `line` counts from 1.

    `line` is None where the fault is not in one line (a file that is missing or empty).
    """

    file: str
    line: int | None
    message: str

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {self.message}"


class StudyFaults(Exception):  # noqa: N818 - it is its faults, one or more
    """A study folder that cannot be used; its text has one line per fault."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


class UnreadableFileError(Exception):
    """A file that cannot be read as text; the message says why, `line` where."""

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line
