"""`python -m app.lab.sureness`: is the optimiser as often right as it says it is sure?

Trials of the default are asked after each query from the tenth on how sure they are that no
candidate is better than the acquired one by more than a tenth of f's range. What was said is set
against what is true, in tenths of what was said; so is the set that holds the best candidate with
95 %. The same trials show what ending a trial early saves and costs: at the first query after which
it is `STOP` sure.
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
#: A trial is asked from this query on.
FIRST_ASKED: Final = 10
QUERIES: Final = 30
#: A trial ends when it is this sure.
STOP: Final = 0.95
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
    """Run one trial, and ask it after each query from `FIRST_ASKED` on."""
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
        if done >= FIRST_ASKED:
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


def summary(said: Sequence[Said], stop: float = STOP) -> str:
    """The 95 % set, and what ending a trial early would do; Markdown."""
    lines = [
        "| | last set: size, holds the best | ended early | queries | regret | regret at the end |",
        "|---|---|---|---|---|---|",
    ]
    for problem in dict.fromkeys(one.problem for one in said):
        own = [one for one in said if one.problem == problem]
        last = max(one.query for one in own)
        ends, finals = [], []
        for key in dict.fromkeys((one.evaluator, one.seed) for one in own):
            trial = [one for one in own if (one.evaluator, one.seed) == key]
            finals.append(trial[-1])
            ends.append(next((one for one in trial if one.sure >= stop), trial[-1]))
        sizes = np.median([one.set_size for one in finals])
        holds = np.mean([one.set_holds for one in finals])
        early = np.mean([one.query < last for one in ends])
        lines.append(
            f"| {problem} | {sizes:.0f}, {100 * holds:.0f} % | {100 * early:.0f} % | "
            f"{np.mean([one.query for one in ends]):.1f} | "
            f"{np.mean([one.regret for one in ends]):.2f} | "
            f"{np.mean([one.regret for one in finals]):.2f} |"
        )
    return "\n".join(lines)


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
    print(summary(said))


if __name__ == "__main__":
    main()
