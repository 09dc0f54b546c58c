"""`python -m app.lab.skip_sensitivity`: which claims of Fig. 10 to 13 hang on when evaluators skip.

The paper does not say when its simulated evaluators skip. Ours skip when both runs lie below the
mean of g, which they do in some 4 of 80 queries; the people of its Fig. 21 skip from a few to
dozens of 30. Here PBPO is run again with every level from no skips at all to the mean plus two
deviations, the other methods as they are, since they offer no skip. The seeds are those of
`pbpo reproduce`, so that level 0 gives its verdicts.
"""

from __future__ import annotations

import os

# Before NumPy, SciPy or PyTorch load: one core for each process.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
from collections.abc import Mapping, Sequence  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any, Final  # noqa: E402

import numpy as np  # noqa: E402

from app.figures import (  # noqa: E402
    save,
    verdicts,
)

from . import claims_simulated  # noqa: E402
from .claims import Claim  # noqa: E402
from .engines import ENGINES, run_each  # noqa: E402
from .environments import World, recorded  # noqa: E402
from .experiments import ENVIRONMENTS, EXPERIMENTS, Task, plan  # noqa: E402
from .results import Results, Trial  # noqa: E402
from .steps import Step, StepTableError, from_csv, to_csv  # noqa: E402
from .store import write_whole  # noqa: E402
from .trials import run_trial  # noqa: E402

#: In deviations of g above its mean; None: evaluators never skip.
LEVELS: Final[tuple[float | None, ...]] = (None, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
#: Laid down before any result: the people of Fig. 21 skip "a few" to "dozens" of 30 queries, read
#: as 3 to 24.
PEOPLE_SKIP: Final = (3, 24)
PEOPLE_QUERIES: Final = 30
FIGURES: Final = (10, 11, 12, 13)


def level_name(level: float | None) -> str:
    """As the table and the files call it."""
    return "none" if level is None else f"{level:+.1f}"


def tasks(trials: int | None = None, seed: int = 0) -> list[tuple[Task, float | None]]:
    """Every trial with its level; methods without a skip run once, at level 0."""
    own = [one for one in EXPERIMENTS if one.name in ("certain", "uncertain")]
    planned = plan(FIGURES, seed, trials, own)
    return [
        (task, level)
        for level in sorted(
            LEVELS, key=lambda level: abs(level or 0.0) if level is not None else 9.0
        )
        for task in planned
        if task.method == "pbpo" or level == 0.0
    ]


def run_level(
    task: Task, level: float | None, world: World
) -> tuple[Task, float | None, list[Step]]:
    """One trial at one level."""
    return task, level, run_trial(task, world, level)


def claims_at(
    level: float | None,
    trials: Mapping[tuple[str, float | None], Trial],
    worlds: Mapping[str, World],
    seed: int,
) -> list[Claim]:
    """The claims of Fig. 10 to 13 with PBPO's trials of this level."""
    of_level = [
        trial
        for (_, at), trial in trials.items()
        if at == (level if trial.task.method == "pbpo" else 0.0)
    ]
    results = Results(of_level, worlds, seed)
    return [
        *claims_simulated.of_curves(results, 10),
        *claims_simulated.of_violins(results, 11),
        *claims_simulated.of_curves(results, 12),
        *claims_simulated.of_violins(results, 13),
    ]


def skips(
    trials: Mapping[tuple[str, float | None], Trial],
    experiment: str,
    environment: str,
    level: float | None,
) -> float:
    """Mean skips in the first 30 queries of PBPO's trials at this level."""
    counts = [
        trial.steps[min(PEOPLE_QUERIES, len(trial.steps)) - 1].skips
        for (_, at), trial in trials.items()
        if at == level
        and (trial.task.experiment, trial.task.environment, trial.task.method)
        == (experiment, environment, "pbpo")
    ]
    return float(np.mean(counts))


def table(
    trials: Mapping[tuple[str, float | None], Trial], worlds: Mapping[str, World], seed: int
) -> str:
    """Levels are columns; a row for the skips of each kind of trial, and one for each claim."""
    lines = [
        "| | | " + " | ".join(level_name(level) for level in LEVELS) + " |",
        "|---|---|" + "---|" * len(LEVELS),
    ]
    for experiment in ("certain", "uncertain"):
        for environment in ENVIRONMENTS:
            cells = []
            for level in LEVELS:
                mean = skips(trials, experiment, environment, level)
                low, high = PEOPLE_SKIP
                cells.append(f"**{mean:.1f}**" if low <= mean <= high else f"{mean:.1f}")
            lines.append(
                f"| {environment}, {experiment} | skips in 30 | " + " | ".join(cells) + " |"
            )
    at = {level: {c.name: c for c in claims_at(level, trials, worlds, seed)} for level in LEVELS}
    for name, claim in at[0.0].items():
        cells = ["holds" if at[level][name].holds else "·" for level in LEVELS]
        lines.append(
            f"| Fig. {claim.figure}, {claim.environment} | {claim.published} | "
            + " | ".join(cells)
            + " |"
        )
    held = [sum(claim.holds for claim in at[level].values()) for level in LEVELS]
    lines.append(f"| | of {len(at[0.0])} claims hold | " + " | ".join(map(str, held)) + " |")
    return "\n".join(lines)


def chart(
    trials: Mapping[tuple[str, float | None], Trial], worlds: Mapping[str, World], seed: int
) -> Any:
    """The same verdicts as a figure."""
    return verdicts(
        [
            {
                "panel": "holds where filled",
                "claim": f"{claim.figure}, {claim.environment}: {claim.published}",
                "setting": level_name(level),
                "holds": claim.holds,
            }
            for level in LEVELS
            for claim in claims_at(level, trials, worlds, seed)
        ],
        x_title="skips below the mean of g plus so many deviations",
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the trials that the folder lacks, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m app.lab.skip_sensitivity", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="the folder of finished trials")
    parser.add_argument("--trials", type=int, help="of each method; the paper's number by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--engine", choices=ENGINES, default="local")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    worlds = {name: recorded(name) for name in ENVIRONMENTS}
    found: dict[tuple[str, float | None], Trial] = {}
    missing = []
    for task, level in tasks(options.trials, options.seed):
        steps = kept(path_of(options.out, task, level), task)
        if steps is None:
            missing.append((task, level, worlds[task.environment]))
        else:
            found[task.name, level] = Trial(task, steps)
    for task, level, steps in run_each(
        run_level, missing, engine=options.engine, jobs=options.jobs
    ):
        write_whole(path_of(options.out, task, level), to_csv(steps).encode())
        found[task.name, level] = Trial(task, steps)
    save(chart(found, worlds, options.seed), options.out, "skip-sensitivity")
    print(table(found, worlds, options.seed))


def path_of(folder: Path, task: Task, level: float | None) -> Path:
    """Where a finished trial is kept."""
    return folder / f"{level_name(level)}-{task.name}-{task.seed}.csv"


def kept(path: Path, task: Task) -> list[Step] | None:
    """The steps of a finished trial, or None."""
    try:
        steps = from_csv(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, StepTableError):
        return None
    return steps if len(steps) == task.steps else None


if __name__ == "__main__":
    main()
