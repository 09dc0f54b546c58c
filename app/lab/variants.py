"""`python -m app.lab.variants`: the table that decides the default of `pbpo-threshold`, from seeds.

Every variant answers the same kind of evaluator (Uncertain, with its skip rule) on the same
problems, with the same trials' seeds, and is judged by the regret f(w*) - f(w_acq) after 30
queries. The peers, which know no skip, answer an evaluator who never skips. docs/optimiser.md holds
the table and what was decided.
"""

from __future__ import annotations

import os

# Before NumPy, SciPy or PyTorch load: one core for everyone.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import csv  # noqa: E402
import warnings  # noqa: E402
from collections.abc import Iterator, Mapping, Sequence  # noqa: E402
from dataclasses import dataclass, replace  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Final  # noqa: E402

import numpy as np  # noqa: E402

from app.lab.peers import PEERS  # noqa: E402
from app.lab.problems import PROBLEMS, Problem  # noqa: E402
from app.pbbo import PRESETS, PreferenceOptimizer, Settings, allows_skip  # noqa: E402

QUERIES: Final = 30
TRIALS: Final = 100
#: Seeds below were used while the default was looked for; these were not.
FIRST_SEED: Final = 50_000
#: A peer's first queries, as many random pairs as ours has.
PEER_RANDOM: Final = 5

#: Streams of a trial's evaluator, and of a peer's random pairs.
ANSWERS: Final = 1
PAIRS: Final = 2


@dataclass(frozen=True)
class Variant:
    """settings: None for the paper's own, of the environment. may_skip: whether it is offered."""

    method: str
    settings: Settings | None
    may_skip: bool = True

    def settings_on(self, problem: str) -> Settings:
        """The settings on this problem; the paper has none for problems that are not its own."""
        if self.settings is not None:
            return self.settings
        return PRESETS[f"paper-{problem}" if f"paper-{problem}" in PRESETS else "paper-env1"]


DEFAULT: Final = Settings()


def _changed(**changes: object) -> Variant:
    return Variant("pbpo-threshold", replace(DEFAULT, **changes))  # type: ignore[arg-type]


VARIANTS: Final[Mapping[str, Variant]] = {
    "pbpo, paper's preset": Variant("pbpo", None),
    "pbpo-threshold": Variant("pbpo-threshold", DEFAULT),
    "without skips": Variant("pbpo-threshold", DEFAULT, may_skip=False),
    "boldness 1": _changed(threshold_boldness=(1.0,)),
    "boldness 2": _changed(threshold_boldness=(2.0,)),
    "boldness 1, 3": _changed(threshold_boldness=(1.0, 3.0)),
    "length scale 0.1": _changed(threshold_length_scales=(0.1,)),
    "length scale 0.33": _changed(threshold_length_scales=(0.33,)),
    "epsilon 0.1": _changed(threshold_epsilon=0.1),
    "epsilon 1": _changed(threshold_epsilon=1.0),
    "threshold as noisy as a choice": _changed(threshold_noise=1.0),
    "covering first phase": _changed(threshold_covering=5),
    "no first phase": _changed(random_queries=0),
}


def trial(variant: Variant, problem: Problem, seed: int, queries: int) -> float:
    """The regret of one variant after one trial."""
    optimizer = PreferenceOptimizer(
        problem.candidates, variant.method, seed, variant.settings_on(problem.name)
    )
    rng = np.random.default_rng([seed, ANSWERS])
    evaluator = problem.evaluator(rng)
    may_skip = variant.may_skip and allows_skip(variant.method)
    for _ in range(queries):
        query = optimizer.ask()
        left, right = shown(problem, query.left, query.right, rng)
        optimizer.tell(query, evaluator.respond(left, right, may_skip=may_skip))
    return problem.regret(optimizer.best())


def peer_trial(name: str, problem: Problem, seed: int, queries: int) -> float:
    """The regret of a peer after one trial of as many queries, none of them skipped."""
    # Scaled to the unit cube, as ours scales them and as the peers' priors expect.
    low, high = problem.candidates.min(axis=0), problem.candidates.max(axis=0)
    peer = PEERS[name]((problem.candidates - low) / (high - low), seed)
    rng = np.random.default_rng([seed, ANSWERS])
    evaluator = problem.evaluator(rng)
    random = np.random.default_rng([seed, PAIRS])
    pairs: list[tuple[int, int]] = []
    for index in range(queries):
        if index < PEER_RANDOM:
            a, b = (int(i) for i in random.choice(len(problem.candidates), 2, replace=False))
        else:
            a, b = peer.step(pairs)
        if random.integers(2):
            a, b = b, a
        left, right = shown(problem, a, b, rng)
        response = evaluator.respond(left, right, may_skip=False)
        pairs.append((a, b) if response == "left" else (b, a))
    peer.step(pairs)
    return problem.regret(peer.best())


def shown(problem: Problem, left: int, right: int, rng: np.random.Generator) -> tuple[float, float]:
    """g of the run shown on each side: one of the candidate's, at random."""
    runs = rng.integers(problem.scores.shape[1], size=2)
    return float(problem.scores[left, runs[0]]), float(problem.scores[right, runs[1]])


@dataclass(frozen=True)
class Outcome:
    """The regret of one variant in one trial on one problem."""

    variant: str
    problem: str
    seed: int
    regret: float


def outcomes(
    variants: Sequence[str], problems: Sequence[str], seeds: Sequence[int], queries: int = QUERIES
) -> Iterator[Outcome]:
    """All trials asked for; variants are names of `VARIANTS` or of `PEERS`."""
    for name in problems:
        problem = PROBLEMS[name]()
        for variant in variants:
            for seed in seeds:
                if variant in PEERS:
                    regret = peer_trial(variant, problem, seed, queries)
                else:
                    regret = trial(VARIANTS[variant], problem, seed, queries)
                yield Outcome(variant, name, seed, regret)


def table(found: Sequence[Outcome]) -> str:
    """Mean regret +- standard error of each variant (rows) on each problem (columns), Markdown."""
    problems = list(dict.fromkeys(outcome.problem for outcome in found))
    lines = ["| | " + " | ".join(problems) + " |", "|---" * (1 + len(problems)) + "|"]
    for variant in dict.fromkeys(outcome.variant for outcome in found):
        cells = []
        for problem in problems:
            regrets = [o.regret for o in found if (o.variant, o.problem) == (variant, problem)]
            cells.append(cell(np.array(regrets)))
        lines.append(f"| {variant} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def cell(regrets: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    """Mean +- standard error, or as much of it as there is."""
    if not len(regrets):
        return ""
    if len(regrets) == 1:
        return f"{regrets[0]:.2f}"
    error = regrets.std(ddof=1) / np.sqrt(len(regrets))
    return f"{regrets.mean():.2f} +- {error:.2f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the trials asked for; print the table, and keep every trial if a file is named."""
    known = [*VARIANTS, *PEERS]
    parser = argparse.ArgumentParser(prog="python -m app.lab.variants", description=__doc__)
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--queries", type=int, default=QUERIES)
    parser.add_argument("--problems", nargs="+", choices=list(PROBLEMS), default=list(PROBLEMS))
    parser.add_argument("--variants", nargs="+", choices=known, default=list(VARIANTS))
    parser.add_argument("--csv", type=Path, help="a file for the regret of every trial")
    options = parser.parse_args(arguments)
    # BoTorch warns of single precision and of points it has jittered; neither is about us.
    warnings.filterwarnings("ignore", module=r"botorch|gpytorch|linear_operator")
    seeds = range(options.first_seed, options.first_seed + options.trials)
    found: list[Outcome] = []
    for outcome in outcomes(options.variants, options.problems, seeds, options.queries):
        found.append(outcome)
        if outcome.seed == seeds[-1]:
            own = [
                o.regret
                for o in found
                if (o.variant, o.problem) == (outcome.variant, outcome.problem)
            ]
            print(f"{outcome.problem}: {outcome.variant}: {cell(np.array(own))}", flush=True)
    if options.csv is not None:
        with options.csv.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["variant", "problem", "seed", "regret"])
            writer.writerows((o.variant, o.problem, o.seed, o.regret) for o in found)
    print()
    print(table(found))


if __name__ == "__main__":
    main()
