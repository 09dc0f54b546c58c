"""The paper's experiments from beginning to end: trials, table, figures, report.

Trials that a folder already holds are not run again, so a run that was killed goes on, and ends
with what it would have given in one go.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from .engines import Engine, run_all
from .environments import World, recorded
from .experiments import ENVIRONMENTS, EXPERIMENTS, FIGURES, Experiment, plan
from .results import Results, Trial
from .steps import to_csv
from .store import Store, identity, write_whole

#: Called with how many trials are there, and how many there will be.
Progress = Callable[[int, int], None]


def reproduce(
    folder: Path,
    *,
    figures: Iterable[int] = FIGURES,
    trials: int | None = None,
    seed: int = 0,
    jobs: int = 1,
    engine: Engine = "local",
    experiments: Iterable[Experiment] = EXPERIMENTS,
    progress: Progress = lambda done, total: None,
) -> Path:
    """Run what these figures need, and write table, figures and report; the report's path.

    trials: of each method, instead of the paper's numbers.
    """
    shown = tuple(sorted(set(figures)))
    results = run(
        folder,
        shown,
        trials=trials,
        seed=seed,
        jobs=jobs,
        engine=engine,
        experiments=experiments,
        progress=progress,
    )
    # Drawing needs Altair, which takes a second to import; a run that is only resumed for its
    # trials' sake should fail early on what is wrong with them, not late.
    from .report import write_report  # noqa: PLC0415

    return write_report(results, shown, folder)


def run(
    folder: Path,
    figures: tuple[int, ...],
    *,
    trials: int | None,
    seed: int,
    jobs: int,
    engine: Engine,
    experiments: Iterable[Experiment],
    progress: Progress,
) -> Results:
    """Run the trials that are not there yet, and write the table of all steps."""
    worlds: Mapping[str, World] = {name: recorded(name) for name in ENVIRONMENTS}
    store = Store(folder, identity(seed, worlds))
    tasks = plan(figures, seed, trials, experiments)
    found = {task: steps for task in tasks if (steps := store.find(task)) is not None}
    missing = [task for task in tasks if task not in found]
    progress(len(found), len(tasks))
    for task, steps in run_all(missing, worlds, engine=engine, jobs=jobs):
        store.keep(task, steps)
        found[task] = steps
        progress(len(found), len(tasks))
    # In the order of the plan, whatever the order in which trials ended.
    ordered = [Trial(task, found[task]) for task in tasks]
    table = to_csv(step for trial in ordered for step in trial.steps)
    write_whole(folder / "steps.csv", table.encode())
    return Results(ordered, worlds, seed)
