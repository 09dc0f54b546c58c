"""The parts of the report that list rather than judge: what was run how, and summaries of f."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from app.figures.theme import label
from app.pbbo import ENGINE_VERSION, PRESETS, SCORE_PRESETS
from app.statistics.comparisons import compare, interquartile_range

from .claims import described
from .evaluators import ETA
from .experiments import (
    CONVERGED_CRANE_RUNS,
    ENVIRONMENTS,
    EXPERIMENTS,
)
from .people import PEOPLE
from .results import Results


def setup(results: Results) -> Iterator[str]:
    """What was run, under which settings, and what we chose where the paper says nothing."""
    yield from (
        "## What was run",
        "",
        f"Seed {results.seed}, engine version {ENGINE_VERSION}. Every trial has a seed of its own,",
        "drawn from this one and its name, so that trials are independent of each other, and are",
        "the same however many there are, on however many processors. All settings were laid down",
        "before any result and not changed after, and are the same for every method they concern.",
        "",
        "| experiment | figures | methods | trials of each in each environment | steps |",
        "|---|---|---|---|---|",
    )
    counts = results.counts()
    levels = " and ".join(f"{results.worlds[name].mean:.1f} in {name}" for name in ENVIRONMENTS)
    for experiment in EXPERIMENTS:
        run = {
            method: counts.get((experiment.name, "env1", method), 0) for method in experiment.arms
        }
        if not any(run.values()):
            continue
        figures = sorted({figure for shown in experiment.arms.values() for figure in shown})
        unit = "crane runs" if experiment.evaluator == "score" else "queries"
        yield (
            f"| {experiment.name} | {', '.join(str(figure) for figure in figures)} | "
            f"{', '.join(label(method) for method, count in run.items() if count)} | "
            f"{', '.join(str(n) for n in sorted({count for count in run.values() if count}))} | "
            f"{experiment.steps} {unit} |"
        )
    yield ""
    yield from _models()
    yield from _evaluators(results)
    yield from (
        "A query shows one of each candidate's five recorded runs, drawn at random for each side;",
        "BO and RBO measure one drawn the same way. f is the mean of g over all five. All g and f",
        "are in grams. Where the paper says nothing, or not what it means, we took:",
        "",
        "- W holds w0 ≥ w1: the text prints the opposite, its optima and its 231 points need this.",
        "- The paper's length scale l is read as exp(-d² / (2 l)): as an ordinary length scale,",
        "  neighbours on the grid would tell nothing about each other.",
        f"- Evaluators of Fig. 10 to 13 skip when both g lie below the mean of g over W: {levels}.",
        "- A skip of a pair of which one was chosen before is synthesised with another choice.",
        f"- BO and RBO have converged after {CONVERGED_CRANE_RUNS} crane runs; PBPO gets half.",
        "- RBO's robust model is a Gaussian process with a Student-t likelihood.",
        "- Fig. 17 counts queries, skipped ones included, as its experiment does.",
        "",
    )


def _models() -> Iterator[str]:
    yield from (
        "| | length scale (ordinary) | epsilon or noise | kappa | random at first |",
        "|---|---|---|---|---|",
    )
    for environment in ENVIRONMENTS:
        preset = PRESETS[f"paper-{environment}"]
        yield (
            f"| PBPO, all variants, {environment} | {preset.length_scale:.3g} | "
            f"{preset.epsilon:g} | - | until {preset.random_queries} answers |"
        )
        for method in ("rbo", "bo"):
            score = SCORE_PRESETS[f"paper-{environment}-{method}"]
            yield (
                f"| {label(method)}, {environment} | {score.length_scale:.3g} | {score.noise:g} of "
                f"the scores' deviation | {score.kappa:g} | {score.random_queries} runs |"
            )
    yield ""


def _evaluators(results: Results) -> Iterator[str]:
    yield from (
        "*Certain* prefers the run with the larger g. *Uncertain* prefers the left one with",
        f"probability 1 / (1 + exp(-{ETA:g} (g_left - g_right))). *Demanding* is *Uncertain*, but",
        "skips below the mean of g plus one deviation: not in the paper, and behind no verdict.",
        "",
    )
    if not any(experiment == "people" for experiment, _, _ in results.counts()):
        return
    yield from (
        "Five simulated evaluators stand in for people, each in a fifth of the trials. They answer",
        "like *Uncertain*, each with an eta of their own. Under PBPO they skip when both runs lie",
        "below a level of their own (mean of g over W plus so many of its standard deviations);",
        "under PBPO w/o synthesis, where the button says that a choice is hard, when the two runs'",
        "g differ by less than a distance of their own.",
        "",
        "| simulated evaluator | eta | skips below, in deviations of g | equal within, g |",
        "|---|---|---|---|",
    )
    for number, traits in enumerate(PEOPLE, start=1):
        yield (
            f"| {number} | {traits.eta:.3f} | {traits.skip_level:+.1f} | {traits.equal_within:g} |"
        )
    yield ""


def summary(
    results: Results, experiment: str, methods: Sequence[str], queries: Sequence[int]
) -> Iterator[str]:
    """f of what was acquired, as mean, median and quartile range."""
    yield from (
        "| f acquired | after | mean ± deviation | median | interquartile range |",
        "|---|---|---|---|---|",
    )
    for environment in ENVIRONMENTS:
        for method in methods:
            for count in queries:
                values = results.after_queries(experiment, environment, method, count)
                yield (
                    f"| {environment}, {label(method)} | {count} | {np.mean(values):.1f} ± "
                    f"{np.std(values, ddof=1):.1f} | {np.median(values):.1f} | "
                    f"{interquartile_range(values):.1f} |"
                )
    yield ""


def of_demanding(results: Results, queries: Sequence[int]) -> Iterator[str]:
    """Under Uncertain, what a higher skip level changes: beside the claims, behind none of them."""
    yield from (
        "When the paper's simulated evaluators skip is not stated. How much hangs on it (no claim,",
        "no verdict): PBPO with an evaluator who skips below the mean of g plus one deviation,",
        "against the same PBPO w/o skip as above.",
        "",
        "| | skips in a trial, as above | skips, demanding | after | against PBPO w/o skip |",
        "|---|---|---|---|---|",
    )
    for environment in ENVIRONMENTS:
        skips = [
            float(np.mean([t.steps[-1].skips for t in results.trials(name, environment, "pbpo")]))
            for name in ("uncertain", "demanding")
        ]
        for count in queries:
            found = compare(
                results.after_queries("demanding", environment, "pbpo", count),
                results.after_queries("uncertain", environment, "pbpo-no-skip", count),
            )
            yield (
                f"| {environment} | {skips[0]:.1f} | {skips[1]:.1f} | {count} | "
                f"{described(found)} |"
            )
    yield ""
