"""`python -m app.lab.sureness`: is the optimiser as often right as it says it is sure?

Trials of the default are asked after each query how sure they are that no candidate is better than
the acquired one by more than a tenth of f's range. What was said from the tenth query on is set
against what is true, in tenths of what was said; so is the set that holds the best candidate with
95 %. The same trials show what ending a trial early saves and costs: after the first query by which
it is sure enough, as with `stop` in a study's plan.
"""

from __future__ import annotations

import os

# Before NumPy, SciPy or PyTorch load: one core for each process.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import csv  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from dataclasses import asdict, dataclass, fields  # noqa: E402
from itertools import pairwise  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Final  # noqa: E402

import numpy as np  # noqa: E402

from app.pbbo import PreferenceOptimizer  # noqa: E402

from .answering import EVALUATORS  # noqa: E402
from .engines import ENGINES, run_each  # noqa: E402
from .problems import PROBLEMS  # noqa: E402
from .variant_trials import ANSWERS, shown  # noqa: E402

METHOD: Final = "pbpo-threshold"
#: The share of f's range that a better candidate may be better by.
WITHIN: Final = 0.1
#: What a trial says counts from this query on.
FIRST_ASKED: Final = 10
QUERIES: Final = 30
#: A trial ends when it is this sure.
STOPS: Final = (0.7, 0.8, 0.9, 0.95)
BINS: Final = 10


@dataclass(frozen=True)
class Said:
    """What a trial said after a query, and what was true.

    sure: said.  right: whether no candidate was better by more than `WITHIN`.  set_size,
    set_holds: of the 95 % set, and whether the best candidate was in it.  regret: as elsewhere.
    """

    problem: str
    evaluator: str
    seed: int
    query: int
    sure: float
    right: bool
    set_size: int
    set_holds: bool
    regret: float


def ask(problem_name: str, evaluator_name: str, seed: int, queries: int = QUERIES) -> list[Said]:
    """Run one trial, and ask it after each query."""
    problem = PROBLEMS[problem_name]()
    optimizer = PreferenceOptimizer(problem.candidates, METHOD, seed)
    rng = np.random.default_rng([seed, ANSWERS])
    evaluator = EVALUATORS[evaluator_name](problem, rng)
    span = float(np.ptp(problem.f))
    said = []
    for done in range(1, queries + 1):
        query = optimizer.ask()
        left, right = shown(problem, query.left, query.right, rng)
        optimizer.tell(query, evaluator.respond(left, right, may_skip=True))
        regret = problem.regret(optimizer.best())
        likely = optimizer.may_be_best()
        said.append(
            Said(
                problem=problem_name,
                evaluator=evaluator_name,
                seed=seed,
                query=done,
                sure=optimizer.sureness(WITHIN),
                right=regret <= WITHIN * span,
                set_size=len(likely),
                set_holds=int(np.argmax(problem.f)) in likely,
                regret=regret,
            )
        )
    return said


def calibration(said: Sequence[Said]) -> str:
    """Said against true, in tenths of what was said; Markdown."""
    lines = [
        "| said | how often | mean said | true | standard error |",
        "|---|---|---|---|---|",
    ]
    said = [one for one in said if one.query >= FIRST_ASKED]
    edges = np.linspace(0.0, 1.0, BINS + 1)
    for low, high in pairwise(edges):
        # The last tenth holds 1.
        held = [one for one in said if low <= one.sure < high or (high == one.sure == 1.0)]
        if not held:
            continue
        true = float(np.mean([one.right for one in held]))
        trials = len({(one.problem, one.evaluator, one.seed) for one in held})
        error = float(np.sqrt(true * (1.0 - true) / trials))
        mean = float(np.mean([one.sure for one in held]))
        lines.append(
            f"| {low:.1f} to {high:.1f} | {len(held)} | {mean:.2f} | {true:.2f} | {error:.2f} |"
        )
    return "\n".join(lines)


def sets(said: Sequence[Said]) -> str:
    """The 95 % set at the end of trials: its median size, how often it holds the best; Markdown."""
    lines = ["| | trials | candidates in the set | holds the best |", "|---|---|---|---|"]
    for problem, trials in _trials(said).items():
        ends = [trial[-1] for trial in trials]
        size = np.median([one.set_size for one in ends])
        holds = np.mean([one.set_holds for one in ends])
        lines.append(f"| {problem} | {len(ends)} | {size:.0f} | {100 * holds:.0f} % |")
    return "\n".join(lines)


def stopping(said: Sequence[Said], stops: Sequence[float] = STOPS) -> str:
    """What ending trials as soon as they are so sure saves and costs; Markdown.

    A cost is the mean of the differences within trials, with its standard error.
    """
    lines = [
        "| | sure | ended early | queries | regret then | at the last query | cost |",
        "|---|---|---|---|---|---|---|",
    ]
    for problem, trials in _trials(said).items():
        last = np.array([trial[-1].regret for trial in trials])
        for stop in stops:
            ends = [next((one for one in trial if one.sure >= stop), trial[-1]) for trial in trials]
            early = np.mean(
                [end.query < trial[-1].query for end, trial in zip(ends, trials, strict=True)]
            )
            then = np.array([end.regret for end in ends])
            cost = then - last
            error = cost.std(ddof=1) / np.sqrt(len(cost)) if len(cost) > 1 else np.nan
            lines.append(
                f"| {problem} ({len(trials)}) | {stop:g} | {100 * early:.0f} % | "
                f"{np.mean([end.query for end in ends]):.1f} | {then.mean():.2f} | "
                f"{last.mean():.2f} | {cost.mean():+.2f} ± {error:.2f} |"
            )
    return "\n".join(lines)


def _trials(said: Sequence[Said]) -> dict[str, list[list[Said]]]:
    """What each trial said, in order, by problem."""
    found: dict[str, dict[tuple[str, int], list[Said]]] = {}
    for one in said:
        trials = found.setdefault(one.problem, {})
        trials.setdefault((one.evaluator, one.seed), []).append(one)
    return {problem: list(trials.values()) for problem, trials in found.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the trials, write what they said, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m app.lab.sureness", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="a CSV file")
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=200_000)
    parser.add_argument("--queries", type=int, default=QUERIES)
    parser.add_argument("--problems", nargs="+", choices=list(PROBLEMS), default=["env1", "env2"])
    parser.add_argument("--evaluators", nargs="+", choices=list(EVALUATORS), default=["uncertain"])
    parser.add_argument("--engine", choices=ENGINES, default="local")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.trials)
    calls = [
        (problem, evaluator, seed, options.queries)
        for seed in seeds
        for problem in options.problems
        for evaluator in options.evaluators
    ]
    said: list[Said] = []
    with options.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Said)])
        writer.writeheader()
        for trial in run_each(ask, calls, engine=options.engine, jobs=options.jobs):
            said += trial
            writer.writerows(asdict(one) for one in trial)
            file.flush()
    print(calibration(said))
    print()
    print(sets(said))
    print()
    print(stopping(said))


if __name__ == "__main__":
    main()
