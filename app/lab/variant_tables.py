"""The tables of a comparison of variants: regret, failures, and differences seed by seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .problems import PROBLEMS
from .variant_trials import LOOKS, Outcome

FloatArray = NDArray[np.float64]

#: (variant, problem, evaluator)
Cell = tuple[str, str, str]
#: Below this many values there is no standard error.
ENOUGH: Final = 2


def tables(found: Sequence[Outcome], *, against: str, groups: Mapping[str, Sequence[str]]) -> str:
    """A Markdown table for each evaluator and look; see `table`."""
    evaluators = list(dict.fromkeys(outcome.call.evaluator for outcome in found))
    return "\n\n".join(
        f"{evaluator}, after {LOOKS[look]} queries\n\n"
        + table([o for o in found if o.call.evaluator == evaluator], look, against, groups)
        for evaluator in evaluators
        for look in range(max(len(outcome.regrets) for outcome in found))
    )


def table(
    found: Sequence[Outcome], look: int, against: str, groups: Mapping[str, Sequence[str]]
) -> str:
    """Variants are rows, problems columns; all problems of a group that were run share one.

    A cell: mean regret +- standard error, median, share of failures, and in brackets the mean
    difference from `against` on the same seeds +- its standard error, with the number of trials.
    """
    variants = list(dict.fromkeys(outcome.call.variant for outcome in found))
    columns = columns_of(found, groups)
    regrets = {
        (o.call.variant, o.call.problem, o.call.seed): o.regrets[look]
        for o in found
        if len(o.regrets) > look
    }
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (1 + len(columns)) + "|"]
    for variant in variants:
        cells = [cell(regrets, variant, members, against) for members in columns.values()]
        lines.append(f"| {variant} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def columns_of(
    found: Sequence[Outcome], groups: Mapping[str, Sequence[str]]
) -> dict[str, list[str]]:
    """The problems of each column, by its name."""
    columns: dict[str, list[str]] = {}
    for problem in dict.fromkeys(outcome.call.problem for outcome in found):
        column = next(
            (name for name, members in groups.items() if problem in members and "crane" in name),
            problem,
        )
        columns.setdefault(column, []).append(problem)
    return columns


def cell(
    regrets: Mapping[tuple[str, str, int], float],
    variant: str,
    problems: Sequence[str],
    against: str,
) -> str:
    """One cell of `table`."""
    own = {key[1:]: value for key, value in regrets.items() if key[0] == variant}
    own = {key: value for key, value in own.items() if key[0] in problems}
    if not own:
        return ""
    values = np.array(list(own.values()))
    limits = np.array([PROBLEMS[problem]().failure for problem, _ in own])
    text = f"{with_error(values)}, median {np.median(values):.2f}, "
    text += f"{100 * (values > limits).mean():.1f} %"
    if variant != against:
        paired = [
            value - regrets[against, *key]
            for key, value in own.items()
            if (against, *key) in regrets
        ]
        if paired:
            text += f" [{with_error(np.array(paired), sign='+')}]"
    return f"{text} ({len(values)})"


def with_error(values: FloatArray, sign: str = "") -> str:
    """Mean +- standard error, or the mean alone of too few values."""
    mean = f"{values.mean():{sign}.2f}"
    if len(values) < ENOUGH:
        return mean
    return f"{mean} ± {values.std(ddof=1) / np.sqrt(len(values)):.2f}"
