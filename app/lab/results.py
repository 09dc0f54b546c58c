"""The results of a reproduction: its trials, and what was acquired in them after so many steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from .environments import World
from .experiments import Task
from .steps import Step


class MissingResultsError(LookupError):
    """Results were asked for that were not run."""


@dataclass(frozen=True)
class Trial:
    """A trial that was run, and all its steps."""

    task: Task
    steps: Sequence[Step]

    def after(self, crane_runs: int) -> Step:
        """The last step within so many runs of the crane."""
        within = [step for step in self.steps if step.crane_runs <= crane_runs]
        if not within or self.steps[-1].crane_runs < crane_runs:
            raise MissingResultsError(
                f"{self.task.name}: expected {crane_runs} crane runs, "
                f"got {self.steps[-1].crane_runs}"
            )
        return within[-1]


class Results:
    """Trials by experiment, environment and method."""

    def __init__(self, trials: Iterable[Trial], worlds: Mapping[str, World], seed: int) -> None:
        self._trials: dict[tuple[str, str, str], list[Trial]] = {}
        for trial in trials:
            task = trial.task
            key = (task.experiment, task.environment, task.method)
            self._trials.setdefault(key, []).append(trial)
        self.worlds = worlds
        self.seed = seed

    def trials(self, experiment: str, environment: str, method: str) -> Sequence[Trial]:
        """In their order; `MissingResultsError` where none was run."""
        try:
            return self._trials[experiment, environment, method]
        except KeyError:
            raise MissingResultsError(
                f"expected trials of {method} in {environment} ({experiment}), got none"
            ) from None

    def counts(self) -> Mapping[tuple[str, str, str], int]:
        """How many trials there are, by experiment, environment and method."""
        return {key: len(trials) for key, trials in self._trials.items()}

    def after_queries(
        self, experiment: str, environment: str, method: str, queries: int
    ) -> list[float]:
        """f of what each trial had acquired after so many queries of two choices, in grams."""
        return self.after_runs(experiment, environment, method, 2 * queries)

    def after_runs(
        self, experiment: str, environment: str, method: str, crane_runs: int
    ) -> list[float]:
        """f of what each trial had acquired after so many runs of the crane, in grams."""
        trials = self.trials(experiment, environment, method)
        return [trial.after(crane_runs).f for trial in trials]

    def mean_curve(self, experiment: str, environment: str, method: str) -> list[float]:
        """Mean f of what was acquired after each step, in grams."""
        trials = self.trials(experiment, environment, method)
        return [
            sum(step.f for step in steps) / len(steps)
            for steps in zip(*(trial.steps for trial in trials), strict=True)
        ]
