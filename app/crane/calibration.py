"""How close the simulated world comes to the published one (Sec. V-C, Fig. 9), as a table.

``python -m app.crane.calibration`` prints published beside simulated for both environments;
``--fit env1`` repeats the random search (``app.crane.search``) over the physical constants.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import library
from .environments import ENVIRONMENTS
from .landscape import (
    BEST_CANDIDATE_TOLERANCE_S,
    BEST_TOLERANCE,
    DEVIATION_TOLERANCE,
    ENV1_HIGH_AT_LEAST,
    ENV1_HIGH_VALUE,
    ENV2_FIVE_BEST_ABOVE,
    ENV2_MIDDLING_AT_MOST,
    ENV2_MIDDLING_VALUE,
    MEAN_TOLERANCE,
    PUBLISHED,
    Landscape,
    Published,
    landscape,
)
from .search import fit


@dataclass(frozen=True)
class Check:
    """One row of the table: a figure, what it should be, what it is."""

    environment: str
    figure: str
    published: str
    simulated: str
    target: str
    holds: bool


def _close(
    environment: str, figure: str, published: float, simulated: float, tolerance: float
) -> Check:
    return Check(
        environment=environment,
        figure=figure,
        published=f"{published:.1f}",
        simulated=f"{simulated:.1f}",
        target=f"within {tolerance:g}",
        holds=abs(published - simulated) <= tolerance,
    )


def _figures(environment: str, ours: Landscape, published: Published) -> list[Check]:
    away = np.abs(np.subtract(ours.best_candidate, published.best_candidate)).max()
    return [
        _close(environment, "mean of g", published.mean, ours.mean, MEAN_TOLERANCE),
        _close(
            environment,
            "standard deviation of g",
            published.deviation,
            ours.deviation,
            DEVIATION_TOLERANCE,
        ),
        _close(environment, "f(w*)", published.best, ours.best, BEST_TOLERANCE),
        Check(
            environment=environment,
            figure="w*",
            published="({:.2f}, {:.2f})".format(*published.best_candidate),
            simulated="({:.2f}, {:.2f})".format(*ours.best_candidate),
            target=f"within {BEST_CANDIDATE_TOLERANCE_S:g} s",
            # Candidates lie on multiples of 0.05 s: the slack only absorbs binary rounding.
            holds=bool(away <= BEST_CANDIDATE_TOLERANCE_S + 1e-9),
        ),
    ]


def compare(env1: Landscape, env2: Landscape) -> tuple[Check, ...]:
    """All rows: what the paper prints as numbers, then the shapes it describes."""
    return (
        *_figures("env1", env1, PUBLISHED["env1"]),
        Check(
            environment="env1",
            figure=f"candidates with f above {ENV1_HIGH_VALUE:g}",
            published="a wide area",
            simulated=str(env1.high),
            target=f"at least {ENV1_HIGH_AT_LEAST}",
            holds=env1.high >= ENV1_HIGH_AT_LEAST,
        ),
        *_figures("env2", env2, PUBLISHED["env2"]),
        Check(
            environment="env2",
            figure="fifth best f",
            published="high near w*",
            simulated=f"{env2.fifth_best:.1f}",
            target=f"above {ENV2_FIVE_BEST_ABOVE:g}",
            holds=env2.fifth_best > ENV2_FIVE_BEST_ABOVE,
        ),
        Check(
            environment="env2",
            figure=f"candidates with f above {ENV2_MIDDLING_VALUE:g}",
            published="only near w*",
            simulated=str(env2.middling),
            target=f"at most {ENV2_MIDDLING_AT_MOST}",
            holds=env2.middling <= ENV2_MIDDLING_AT_MOST,
        ),
        Check(
            environment="both",
            figure="run-to-run spread of g",
            published="env1 > env2",
            simulated=f"{env1.spread:.1f} > {env2.spread:.1f}",
            target="env1 larger",
            holds=env1.spread > env2.spread,
        ),
    )


def calibration() -> tuple[Check, ...]:
    """The shipped library beside the paper."""
    return compare(*(landscape(library.scores(name)) for name in ENVIRONMENTS))


def table(checks: Sequence[Check]) -> str:
    """The rows as aligned text, in grams and seconds."""
    rows = [("environment", "figure", "published", "simulated", "target", "holds")]
    rows += [
        (c.environment, c.figure, c.published, c.simulated, c.target, "yes" if c.holds else "NO")
        for c in checks
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]
    lines.insert(1, "  ".join("-" * w for w in widths))
    return "\n".join(line.rstrip() for line in lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table (exit 1 if a row does not hold), or repeat the search for the constants."""
    parser = argparse.ArgumentParser(prog="python -m app.crane.calibration", description=__doc__)
    parser.add_argument("--fit", choices=list(ENVIRONMENTS), help="search this world's constants")
    parser.add_argument("--seed", type=int, default=1, help="seed of the search (default 1)")
    parser.add_argument("--draws", type=int, default=40, help="points drawn anywhere")
    parser.add_argument("--steps", type=int, default=300, help="points drawn near the best ones")
    options = parser.parse_args(arguments)
    if options.fit is None:
        checks = calibration()
        print(table(checks))
        return 0 if all(check.holds for check in checks) else 1
    found = fit(
        options.fit, seed=options.seed, draws=options.draws, steps=options.steps, report=print
    )
    print(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
