"""One step of a trial, and the tidy table of all steps.

A row is a query, or a crane run of BO and RBO.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Final


class StepTableError(ValueError):
    """A table that is not one of steps."""


@dataclass(frozen=True)
class Step:
    """What was shown, what came back, and what is acquired after it.

    figures: the paper's figures that show it, apart by spaces. query_index: 0 for the first.
    crane_runs: runs of the crane so far, this step's included. left_run, right_run: which recorded
    run of the candidate was shown. left_score, right_score: its g, in grams; a step of BO or RBO
    has only a left side, and its response is "score". answers, skips: so far. acquired: w_acq, its
    parameters in seconds; f: its value, in grams. preferences_answer, preferences_synthesis: what
    the model has learned so far, by origin.
    """

    experiment: str
    figures: str
    environment: str
    evaluator: str
    method: str
    trial: int
    seed: int
    query_index: int
    crane_runs: int
    trial_type: str
    acquisition: str
    left_candidate: int
    right_candidate: int | None
    left_run: int
    right_run: int | None
    left_score: float
    right_score: float | None
    response: str
    answers: int
    skips: int
    preferences_answer: int
    preferences_synthesis: int
    acquired: int
    acquired_w0: float
    acquired_w1: float
    f: float
    engine_version: str


COLUMNS: Final = tuple(field.name for field in fields(Step))
_TYPES: Final[Mapping[str, str]] = {field.name: str(field.type) for field in fields(Step)}


def to_csv(steps: Iterable[Step]) -> str:
    """The table, with its header; every float in the shortest form that gives it back."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for step in steps:
        values = (getattr(step, name) for name in COLUMNS)
        writer.writerow(["" if value is None else value for value in values])
    return text.getvalue()


def from_csv(text: str) -> list[Step]:
    """The steps of a table, or `StepTableError`."""
    rows = csv.reader(io.StringIO(text))
    header = tuple(next(rows, ()))
    if header != COLUMNS:
        raise StepTableError(f"expected the columns {', '.join(COLUMNS)}, got {', '.join(header)}")
    return [_step(number, row) for number, row in enumerate(rows, start=2)]


def _step(number: int, row: list[str]) -> Step:
    if len(row) != len(COLUMNS):
        raise StepTableError(f"line {number}: expected {len(COLUMNS)} cells, got {len(row)}")
    try:
        return Step(**{name: _value(name, cell) for name, cell in zip(COLUMNS, row, strict=True)})
    except ValueError as error:
        raise StepTableError(f"line {number}: {error}") from error


def _value(name: str, cell: str) -> Any:
    kind = _TYPES[name]
    if kind.endswith("| None"):
        if cell == "":
            return None
        kind = kind.removesuffix("| None").strip()
    try:
        match kind:
            case "int":
                return int(cell)
            case "float":
                return float(cell)
            case _:
                return cell
    except ValueError:
        raise ValueError(f"{name}: expected {kind}, got {cell!r}") from None
