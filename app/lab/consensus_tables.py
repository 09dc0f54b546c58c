"""The tables of a comparison of methods on sets of simulated people, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from .consensus_methods import METHODS, Row
from .consensus_sets import CASES

#: A consensus that is worse by more than this share of the range has been moved.
MOVED: Final = 0.05
COMPARED: Final = (
    "shared less pooled",
    "shared less one person",
    "shared / own",
    "shared less without",
    f"worse by more than {MOVED}",
    "honest named",
    "unreliable named",
    "r found",
)
#: Below this many values there is no standard error.
ENOUGH: Final = 2


def tables(rows: Sequence[Row]) -> str:
    """Consensus regret, personal regret, and what those who are not reliable did."""
    return "\n\n".join(
        [
            "Regret of the population's best, as a share of the range\n\n"
            + regret_table(rows, "consensus"),
            "Regret of the population's best on the mean taste of the honest people of the set\n\n"
            + regret_table(rows, "these"),
            "Regret of people's own bests on their own taste\n\n" + regret_table(rows, "personal"),
            "The shared model against others on the same sets, and who is named\n\n" + aims(rows),
        ]
    )


def regret_table(rows: Sequence[Row], column: str) -> str:
    """Methods are rows, cases columns: mean +- standard error."""
    cases = [name for name in CASES if any(row.case == name for row in rows)]
    counts = {name: len({row.seed for row in rows if row.case == name}) for name in cases}
    head = " | ".join(f"{name} ({counts[name]} sets)" for name in cases)
    lines = [f"| | {head} |", "|---" * (1 + len(cases)) + "|"]
    for method in METHODS:
        cells = []
        for name in cases:
            values = [
                value
                for row in rows
                if (row.method, row.case) == (method, name)
                and (value := getattr(row, column)) is not None
            ]
            cells.append(with_error(values) if values else "")
        if any(cells):
            lines.append(f"| {method} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def aims(rows: Sequence[Row]) -> str:
    """Differences set by set, shares of sets, and shares of people that are named."""
    regrets = {(row.case, row.seed, row.method): row.consensus for row in rows}
    lines = [
        "| | " + " | ".join(COMPARED) + " |",
        "|---" * (1 + len(COMPARED)) + "|",
    ]
    for name, case in CASES.items():
        own = [row for row in rows if row.case == name and row.method == "shared"]
        if not own:
            continue

        def less(method: str, name: str = name, own: Sequence[Row] = own) -> list[float]:
            return [
                row.consensus - regrets[name, row.seed, method]
                for row in own
                if (name, row.seed, method) in regrets
            ]

        alone = [row.consensus for row in rows if row.case == name and row.method == "own"]
        ratio = f"{np.mean([row.consensus for row in own]) / np.mean(alone):.2f}" if alone else ""
        away = less("without")
        moved = f"{100 * np.mean(np.array(away) > MOVED):.0f} %" if away else ""
        unreliable = len(case.unreliable)
        cells = [
            with_error(less("pooled"), sign="+"),
            with_error(less("one person"), sign="+"),
            ratio,
            with_error(away, sign="+"),
            moved,
            share([row.honest_named for row in own], case.people - unreliable),
            share([row.unreliable_named for row in own], unreliable),
            f"{np.mean([row.own_share for row in own if row.own_share is not None]):.2f}",
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def share(named: Sequence[int | None], of: int) -> str:
    """How many of so many people a set are named, in percent."""
    if not of:
        return ""
    return f"{100 * np.mean([count or 0 for count in named]) / of:.1f} %"


def with_error(values: Sequence[float], sign: str = "") -> str:
    """Mean +- standard error, or the mean alone of too few values."""
    if not values:
        return ""
    mean = f"{np.mean(values):{sign}.3f}"
    if len(values) < ENOUGH:
        return mean
    return f"{mean} ± {np.std(values, ddof=1) / np.sqrt(len(values)):.3f}"
