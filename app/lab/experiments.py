"""What is run for which figure of the paper (sections VI and VII), laid down before any result.

Trials and lengths are the paper's, except how long BO and RBO run: the paper says "after
convergence", ours is twice the 60 crane runs that PBPO gets.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from app.pbbo import METHODS, SCORE_METHODS

from .people import PEOPLE

EvaluatorKind = Literal["certain", "uncertain", "demanding", "person", "score"]

ENVIRONMENTS: Final = ("env1", "env2")

#: Queries after which Fig. 11 and 13 compare the methods, and Fig. 17.
VIOLIN_QUERIES: Final = (40, 60, 80)
PEOPLE_QUERIES: Final = (10, 20, 30)
#: Crane runs at which PBPO is compared with BO and RBO, and where those count as converged.
SHARED_CRANE_RUNS: Final = 60
CONVERGED_CRANE_RUNS: Final = 120

#: Seeds of trials fit 63 bits, so that any table holds them.
SEED_BITS: Final = 63


class ExperimentError(ValueError):
    """Something was asked for that is no experiment of the paper."""


@dataclass(frozen=True)
class Task:
    """One trial to be run: everything that decides its outcome but the world."""

    experiment: str
    figures: tuple[int, ...]
    environment: str
    evaluator: str
    method: str
    trial: int
    seed: int
    steps: int

    @property
    def name(self) -> str:
        """Unlike that of any other trial of a reproduction; fit for a file."""
        return f"{self.experiment}-{self.environment}-{self.method}-{self.trial:03d}"


@dataclass(frozen=True)
class Experiment:
    """Trials of several methods with the same kind of evaluator.

    arms: the figures that show each method. trials: of each method in each environment.
    steps: queries (crane runs for BO and RBO) in a trial.
    """

    name: str
    evaluator: EvaluatorKind
    arms: Mapping[str, tuple[int, ...]]
    trials: int
    steps: int

    def __post_init__(self) -> None:
        known = SCORE_METHODS if self.evaluator == "score" else METHODS
        for method in self.arms:
            if method not in known:
                raise ExperimentError(
                    f"{self.name}: expected methods among {', '.join(known)}, got {method!r}"
                )
        for field, value in (("trials", self.trials), ("steps", self.steps)):
            if value < 1:
                raise ExperimentError(f"{self.name}: expected {field} from 1 on, got {value!r}")

    def tasks(self, figures: Iterable[int], root_seed: int, trials: int | None) -> Iterator[Task]:
        """The trials that these figures need. How many there are changes none of them."""
        wanted = set(figures)
        for environment in ENVIRONMENTS:
            for method, shown_in in self.arms.items():
                if wanted.isdisjoint(shown_in):
                    continue
                for trial in range(self.trials if trials is None else trials):
                    yield Task(
                        self.name,
                        shown_in,
                        environment,
                        self._evaluator_of(trial),
                        method,
                        trial,
                        seed_of(root_seed, self.name, environment, method, trial),
                        self.steps,
                    )

    def _evaluator_of(self, trial: int) -> str:
        """Who answers in a trial: people take turns, so that each has as many trials."""
        return f"person-{trial % len(PEOPLE) + 1}" if self.evaluator == "person" else self.evaluator


def seed_of(root_seed: int, *path: str | int) -> int:
    """The seed of a trial: of its own for each, so that trials are independent of each other."""
    text = "/".join(str(part) for part in (root_seed, *path))
    digest = hashlib.sha256(text.encode()).digest()
    return int.from_bytes(digest[:8], "big") >> (64 - SEED_BITS)


EXPERIMENTS: Final[tuple[Experiment, ...]] = (
    Experiment(
        "certain",
        "certain",
        {"pbpo": (10, 11), "pbpo-no-skip": (10, 11), "knockout": (10, 11)},
        trials=50,
        steps=80,
    ),
    Experiment(
        "uncertain",
        "uncertain",
        {"pbpo": (12, 13), "pbpo-no-skip": (12, 13), "knockout": (12, 13)},
        trials=50,
        steps=80,
    ),
    # Not in the paper: when its evaluators skip is not stated, so this shows how much hangs on it.
    Experiment("demanding", "demanding", {"pbpo": (13,)}, trials=50, steps=80),
    Experiment(
        "people",
        "person",
        {"pbpo": (17, 18, 19, 20, 21), "pbpo-no-synthesis": (17,), "pbpo-no-skip": (17,)},
        trials=15,
        steps=30,
    ),
    Experiment(
        "scores",
        "score",
        {"rbo": (18, 19, 20), "bo": (18, 19, 20)},
        trials=30,
        steps=CONVERGED_CRANE_RUNS,
    ),
)

#: Fig. 9 shows the recordings themselves and needs no trial.
FIGURES: Final = (9, 10, 11, 12, 13, 17, 18, 19, 20, 21)


def chosen_figures(text: str | None) -> tuple[int, ...]:
    """The figures named in "10,12"; all of them for None."""
    if text is None:
        return FIGURES
    wanted = set()
    for part in text.split(","):
        name = part.strip()
        if not name.isdecimal() or int(name) not in FIGURES:
            known = ", ".join(str(figure) for figure in FIGURES)
            raise ExperimentError(f"figures: expected some of {known}, got {name!r}")
        wanted.add(int(name))
    return tuple(sorted(wanted))


def plan(
    figures: Iterable[int],
    root_seed: int,
    trials: int | None = None,
    experiments: Iterable[Experiment] = EXPERIMENTS,
) -> list[Task]:
    """Every trial that the figures need, in the order of the table of results."""
    wanted = tuple(figures)
    return [task for one in experiments for task in one.tasks(wanted, root_seed, trials)]
