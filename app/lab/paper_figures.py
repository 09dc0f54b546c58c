"""From results to the paper's figures: the tables each one shows, and the chart drawn from them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, TypeAlias

from app.figures import Row, boxes, counts, maps, mean_curves, violins
from app.figures.theme import label
from app.pbbo import PreferenceOptimizer, ScoreOptimizer
from app.statistics.comparisons import compare

from .environments import World
from .experiments import (
    CONVERGED_CRANE_RUNS,
    ENVIRONMENTS,
    PEOPLE_QUERIES,
    SHARED_CRANE_RUNS,
    VIOLIN_QUERIES,
)
from .results import Results, Trial
from .trials import replayed

#: Any Altair chart that can be saved.
Chart: TypeAlias = Any

PANELS: Final[Mapping[str, str]] = MappingProxyType(
    {"env1": "Env1: clumps", "env2": "Env2: grains"}
)
SIMULATED: Final = ("pbpo", "pbpo-no-skip", "knockout")
ABLATED: Final = ("pbpo", "pbpo-no-synthesis", "pbpo-no-skip")
SCORED: Final = ("pbpo", "rbo", "bo")


def plates(results: Results, figure: int) -> Mapping[str, Chart]:
    """The charts of one of the paper's figures, by the name of their file."""
    return _PLATES[figure](results)


def compared(figure: int) -> tuple[tuple[str, str], ...]:
    """The pairs of methods that a violin plot compares: PBPO against each other, as the paper."""
    return tuple(
        ("pbpo", other) for other in (ABLATED if figure == 17 else SIMULATED) if other != "pbpo"
    )


def final(results: Results, environment: str, method: str) -> Sequence[Trial]:
    """The trials that Fig. 18 to 20 show of a method."""
    return results.trials("people" if method == "pbpo" else "scores", environment, method)


def shown_runs(method: str) -> int:
    """Crane runs after which Fig. 18 and 19 show what a method had acquired."""
    return SHARED_CRANE_RUNS if method == "pbpo" else CONVERGED_CRANE_RUNS


def best_and_worst(trials: Sequence[Trial]) -> tuple[Trial, Trial]:
    """Of all trials, by f of what was acquired after 60 crane runs; the first of equals."""
    ordered = sorted(trials, key=lambda trial: -trial.after(SHARED_CRANE_RUNS).f)
    worst = ordered[-1].after(SHARED_CRANE_RUNS).f
    return ordered[0], next(t for t in ordered if t.after(SHARED_CRANE_RUNS).f == worst)


def belief(trial: Trial, world: World) -> PreferenceOptimizer | ScoreOptimizer:
    """The optimiser of a trial as it was after 60 crane runs."""
    steps = [step for step in trial.steps if step.crane_runs <= SHARED_CRANE_RUNS]
    return replayed(trial.task, world, steps)


def _map_of_scores(results: Results) -> Mapping[str, Chart]:
    rows: list[Row] = []
    for name in ENVIRONMENTS:
        world = results.worlds[name]
        rows += _over(world, f"{PANELS[name]}, mean of g", world.f)
        rows += _over(world, f"{PANELS[name]}, deviation of g", world.scores.std(axis=1))
    best = [
        _place(f"{PANELS[name]}, mean of g", results.worlds[name], results.worlds[name].best)
        for name in ENVIRONMENTS
    ]
    chart = maps(rows, optimum=best, columns=2, shared=False, value_title="grams")
    return {"fig9": chart}


def _curves(number: int, experiment: str) -> Callable[[Results], Mapping[str, Chart]]:
    def draw(results: Results) -> Mapping[str, Chart]:
        rows = [
            {
                "panel": PANELS[environment],
                "method": method,
                "query": step.query_index + 1,
                "value": step.f,
            }
            for environment in ENVIRONMENTS
            for method in SIMULATED
            for trial in results.trials(experiment, environment, method)
            for step in trial.steps
        ]
        return {f"fig{number}": mean_curves(rows, methods=SIMULATED, optimum=_optima(results))}

    return draw


def _violins(
    number: int, experiment: str, methods: Sequence[str], queries: Sequence[int]
) -> Callable[[Results], Mapping[str, Chart]]:
    def draw(results: Results) -> Mapping[str, Chart]:
        rows: list[Row] = []
        stars: list[Row] = []
        for environment in ENVIRONMENTS:
            for group in queries:
                panel = {"panel": PANELS[environment], "group": group}
                values = {
                    method: results.after_queries(experiment, environment, method, group)
                    for method in methods
                }
                rows += [
                    {**panel, "method": method, "value": value}
                    for method, of_method in values.items()
                    for value in of_method
                ]
                stars += [
                    {
                        **panel,
                        "first": first,
                        "second": second,
                        "stars": compare(values[first], values[second]).stars,
                    }
                    for first, second in compared(number)
                ]
        chart = violins(rows, methods=methods, stars=stars, optimum=_optima(results))
        return {f"fig{number}": chart}

    return draw


def _boxes(results: Results) -> Mapping[str, Chart]:
    rows = [
        {"panel": PANELS[environment], "method": method, "value": trial.after(shown_runs(method)).f}
        for environment in ENVIRONMENTS
        for method in SCORED
        for trial in final(results, environment, method)
    ]
    return {"fig18": boxes(rows, methods=SCORED, optimum=_optima(results))}


def _acquired(results: Results) -> Mapping[str, Chart]:
    charts: dict[str, Chart] = {}
    for environment in ENVIRONMENTS:
        world = results.worlds[environment]
        rows: list[Row] = []
        points: list[Row] = []
        optimum: list[Row] = []
        for method in SCORED:
            panel = f"{PANELS[environment]}, {label(method)}"
            rows += _over(world, panel, world.f)
            optimum.append(_place(panel, world, world.best))
            points += [
                _place(panel, world, trial.after(shown_runs(method)).acquired)
                for trial in final(results, environment, method)
            ]
        charts[f"fig19-{environment}"] = maps(
            rows, points=points, optimum=optimum, columns=3, value_title="f(w)"
        )
    return charts


def _posteriors(results: Results) -> Mapping[str, Chart]:
    charts: dict[str, Chart] = {}
    for environment in ENVIRONMENTS:
        world = results.worlds[environment]
        rows: list[Row] = []
        points: list[Row] = []
        optimum: list[Row] = []
        extremes = {
            method: best_and_worst(final(results, environment, method)) for method in SCORED
        }
        for place, name in enumerate(("best", "worst")):
            truth = "True f(w)" + " " * place  # a panel of its own beside the best and the worst
            rows += _over(world, truth, world.f)
            optimum.append(_place(truth, world, world.best))
            for method in SCORED:
                panel = f"{label(method)}, {name} trial"
                trial = extremes[method][place]
                mean, _ = belief(trial, world).posterior()
                rows += _over(world, panel, mean)
                optimum.append(_place(panel, world, world.best))
                points += [_place(panel, world, candidate) for candidate in _tried(trial)]
        charts[f"fig20-{environment}"] = maps(
            rows,
            points=points,
            optimum=optimum,
            columns=4,
            size=170,
            shared=False,
            value_title="mean",
        )
    return charts


def _skips(results: Results) -> Mapping[str, Chart]:
    rows = [
        {
            "panel": PANELS[environment],
            "person": trial.task.evaluator.removeprefix("person-"),
            "count": trial.steps[-1].skips,
        }
        for environment in ENVIRONMENTS
        for trial in results.trials("people", environment, "pbpo")
    ]
    return {"fig21": counts(rows, x_title="simulated evaluator", y_title="skips of 30 queries")}


def _optima(results: Results) -> Mapping[str, float]:
    return {PANELS[name]: float(world.f[world.best]) for name, world in results.worlds.items()}


def _over(world: World, panel: str, values: Any) -> Iterator[Row]:
    for (w0, w1), value in zip(world.candidates, values, strict=True):
        yield {"panel": panel, "w0": float(w0), "w1": float(w1), "value": float(value)}


def _place(panel: str, world: World, candidate: int) -> Row:
    w0, w1 = world.candidates[candidate]
    return {"panel": panel, "w0": float(w0), "w1": float(w1)}


def _tried(trial: Trial) -> Iterator[int]:
    """The candidates that the crane ran in the first 60 runs of a trial."""
    for step in trial.steps:
        if step.crane_runs <= SHARED_CRANE_RUNS:
            yield step.left_candidate
            if step.right_candidate is not None:
                yield step.right_candidate


_PLATES: Final[Mapping[int, Callable[[Results], Mapping[str, Chart]]]] = MappingProxyType(
    {
        9: _map_of_scores,
        10: _curves(10, "certain"),
        11: _violins(11, "certain", SIMULATED, VIOLIN_QUERIES),
        12: _curves(12, "uncertain"),
        13: _violins(13, "uncertain", SIMULATED, VIOLIN_QUERIES),
        17: _violins(17, "people", ABLATED, PEOPLE_QUERIES),
        18: _boxes,
        19: _acquired,
        20: _posteriors,
        21: _skips,
    }
)
