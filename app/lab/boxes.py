"""`python -m app.lab.boxes`: the box against the grid, and one new point per query against two.

The cranes over the triangle 0 <= w1 <= w0 <= 1, Ackley-4 and Hartmann-6 in their cubes. The grid's
candidates are those of the other comparisons (231 of a step of 0.05, 500 Sobol points). Regret is
against the best value over the box, which is searched for, so the grid has a floor of its own.
"""

from __future__ import annotations

import os

# Before NumPy, SciPy or PyTorch load: one core for each process.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import csv  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Sequence  # noqa: E402
from dataclasses import asdict, dataclass, fields  # noqa: E402
from functools import cache  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any, Final  # noqa: E402

import numpy as np  # noqa: E402

from app.crane.environments import Environment, environment_named  # noqa: E402
from app.pbbo import Box, BoxOptimizer, PreferenceOptimizer  # noqa: E402

from .drawn_cranes import drawn_crane  # noqa: E402
from .engines import ENGINES, run_each  # noqa: E402
from .evaluators import Uncertain  # noqa: E402
from .fast_runs import runs_at_once  # noqa: E402
from .fresh_runs import FRESH_SEED, RUNS  # noqa: E402
from .problems import (  # noqa: E402
    CHOOSING_CRANES,
    DECIDING_CRANES,
    PROBLEMS,
    FloatArray,
    Problem,
    ackley,
    hartmann,
)
from .variant_tables import with_error  # noqa: E402
from .variant_trials import ANSWERS  # noqa: E402

QUERIES: Final = 30
#: How the best value of a crane is searched for: around so many of the grid's best, at this step.
SEARCHED: Final = 6
FINE_STEP: Final = 0.01
FINE_REACH: Final = 4


@dataclass(frozen=True, eq=False)
class BoxProblem:
    """A problem over a box.

    seen: g of one run of a point, for an evaluator.  value: f of a point.  best: of all of the box.
    problem: the same over its candidates.
    """

    box: Box
    seen: Callable[[FloatArray, np.random.Generator], float]
    value: Callable[[FloatArray], float]
    best: float
    problem: Problem


@cache
def box_problem(name: str) -> BoxProblem:
    """The problem of this name over its box."""
    problem = PROBLEMS[name]()
    if name in ("ackley4", "hartmann6"):
        function = ackley if name == "ackley4" else hartmann
        d = problem.candidates.shape[1]

        def at(point: FloatArray) -> float:
            return float(function(point[None])[0])

        best = 0.0 if name == "ackley4" else 3.32237
        box = Box(low=[0.0] * d, high=[1.0] * d)
        return BoxProblem(box, lambda point, _: at(point), at, best, problem)
    drawn = name.startswith("crane")
    environment = drawn_crane(int(name[-2:])) if drawn else environment_named(name)
    box = Box(low=[0.0, 0.0], high=[1.0, 1.0], constraints=["w0 >= w1"], names=["w0", "w1"])
    return BoxProblem(
        box,
        lambda point, rng: float(runs_at_once(environment, pair(point), rng, 1)[0]),
        lambda point: true_value(environment, point),
        searched(environment, problem),
        problem,
    )


def pair(point: FloatArray) -> tuple[float, float]:
    """w0 and w1."""
    return float(point[0]), float(point[1])


def true_value(environment: Environment, point: FloatArray) -> float:
    """f of a crane anywhere: the mean of g over fresh runs, of the same draws at each point."""
    return float(
        runs_at_once(environment, pair(point), np.random.default_rng([FRESH_SEED]), RUNS).mean()
    )


def searched(environment: Environment, problem: Problem) -> float:
    """The best f found on a finer grid around the best candidates."""
    steps = FINE_STEP * np.arange(-FINE_REACH, FINE_REACH + 1)
    best = -np.inf
    for candidate in np.argsort(-problem.f)[:SEARCHED]:
        for w0 in problem.candidates[candidate, 0] + steps:
            for w1 in problem.candidates[candidate, 1] + steps:
                if 0.0 <= w1 <= w0 <= 1.0:
                    best = max(best, true_value(environment, np.array([w0, w1])))
    return best


@dataclass(frozen=True)
class BoxOutcome:
    """A finished trial. way: "grid", "box" or "box, one new". points: different ones shown.
    step_ms: median processor time of taking an answer and finding the next query."""

    problem: str
    way: str
    seed: int
    regret: float
    points: int
    step_ms: float


WAYS: Final = ("grid", "box", "box, one new")


def run_box(name: str, way: str, seed: int, queries: int = QUERIES) -> BoxOutcome:
    """One trial."""
    world = box_problem(name)
    problem = world.problem
    rng = np.random.default_rng([seed, ANSWERS])
    evaluator = Uncertain(rng, skip_below=problem.mean, eta=problem.eta)
    optimizer: Any
    if way == "grid":
        optimizer = PreferenceOptimizer(problem.candidates, "pbpo-threshold", seed)
        points = problem.candidates
    else:
        optimizer = BoxOptimizer(world.box, seed=seed, new=1 if way == "box, one new" else 2)
    shown = set()
    spent = []
    for _ in range(queries):
        before = time.process_time()
        query = optimizer.ask()
        took = time.process_time() - before
        sides = [points[side] if way == "grid" else side for side in (query.left, query.right)]
        shown |= {world.box.key(side) for side in sides}
        left, right = (world.seen(side, rng) for side in sides)
        response = evaluator.respond(left, right, may_skip=True)
        before = time.process_time()
        optimizer.tell(query, response)
        spent.append(took + time.process_time() - before)
    best = points[optimizer.best()] if way == "grid" else optimizer.best()
    regret = world.best - world.value(best)
    return BoxOutcome(name, way, seed, regret, len(shown), 1e3 * float(np.median(spent[-5:])))


def table(found: Sequence[BoxOutcome]) -> str:
    """Mean regret, its difference from the grid's on the same seeds, and points shown; Markdown."""
    lines = [
        "| | way | regret | median | against the grid | points | step, ms |",
        "|---|---|---|---|---|---|---|",
    ]
    for problem in dict.fromkeys(one.problem for one in found):
        grid = {
            one.seed: one.regret for one in found if (one.problem, one.way) == (problem, "grid")
        }
        for way in WAYS:
            own = sorted(
                (one for one in found if (one.problem, one.way) == (problem, way)),
                key=lambda one: one.seed,
            )
            if not own:
                continue
            regrets = np.array([one.regret for one in own])
            paired = np.array([one.regret - grid[one.seed] for one in own if one.seed in grid])
            gain = with_error(paired, sign="+") if way != "grid" and len(paired) else ""
            lines.append(
                f"| {problem} ({len(own)}) | {way} | {with_error(regrets)} | "
                f"{np.median(regrets):.2f} | {gain} | {max(one.points for one in own)} | "
                f"{np.median([one.step_ms for one in own]):.0f} |"
            )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the trials, write them, and print the table."""
    names = ["env1", "env2", *CHOOSING_CRANES, *DECIDING_CRANES, "ackley4", "hartmann6"]
    parser = argparse.ArgumentParser(prog="python -m app.lab.boxes", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="a CSV file")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=200_000)
    parser.add_argument("--queries", type=int, default=QUERIES)
    parser.add_argument("--problems", nargs="+", choices=names, default=["env1", "env2"])
    parser.add_argument("--engine", choices=ENGINES, default="local")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.trials)
    calls = [
        (problem, way, seed, options.queries)
        for seed in seeds
        for problem in options.problems
        for way in WAYS
    ]
    found: list[BoxOutcome] = []
    with options.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(BoxOutcome)])
        writer.writeheader()
        for outcome in run_each(run_box, calls, engine=options.engine, jobs=options.jobs):
            found.append(outcome)
            writer.writerow(asdict(outcome))
            file.flush()
    print(table(found))


if __name__ == "__main__":
    main()
