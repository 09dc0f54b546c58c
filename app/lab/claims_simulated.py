"""The paper's claims about its worlds and about simulated evaluators (sections V-C and VI)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from app.crane.landscape import (
    BEST_CANDIDATE_TOLERANCE_S,
    BEST_TOLERANCE,
    DEVIATION_TOLERANCE,
    ENV1_HIGH_VALUE,
    MEAN_TOLERANCE,
    PUBLISHED,
    landscape,
)
from app.figures.theme import label
from app.statistics.comparisons import interquartile_range

from .claims import Claim, Pair, alike, better
from .experiments import ENVIRONMENTS, VIOLIN_QUERIES
from .results import Results

#: From this query on the paper sees its method above the Baseline (section VI-B-1).
AHEAD_FROM: Final = 30
#: Medians this close to f(w*), in grams, have reached it: f of two candidates never is.
REACHED: Final = 1e-9

#: p-values against the Baseline under Certain, and against PBPO without skip under Uncertain.
CERTAIN_P: Final = {
    ("env1", 60): ".0029",
    ("env1", 80): ".0023",
    ("env2", 40): ".043",
    ("env2", 60): ".00027",
    ("env2", 80): ".00018",
}
UNCERTAIN_P: Final = {
    ("env1", 40): ".0011",
    ("env1", 60): ".0061",
    ("env1", 80): ".0073",
    ("env2", 60): ".029",
    ("env2", 80): ".019",
}


def of_the_worlds(results: Results) -> Iterator[Claim]:
    """Fig. 9: the recordings that everything else rests on."""
    spreads = {}
    high = {}
    for name in ENVIRONMENTS:
        published, world = PUBLISHED[name], results.worlds[name]
        ours = landscape(world.scores)
        spreads[name] = ours.spread
        high[name] = int(np.count_nonzero(world.f > ENV1_HIGH_VALUE))
        away = max(
            abs(a - b) for a, b in zip(ours.best_candidate, published.best_candidate, strict=True)
        )
        yield Claim(
            f"fig9-{name}-optimum",
            9,
            name,
            f"w* = {published.best_candidate}",
            f"w* = {ours.best_candidate}",
            f"within {BEST_CANDIDATE_TOLERANCE_S} s in each parameter",
            away <= BEST_CANDIDATE_TOLERANCE_S + 1e-9,
        )
        for what, theirs, value, tolerance in (
            ("f(w*)", published.best, ours.best, BEST_TOLERANCE),
            ("mean of g over W", published.mean, ours.mean, MEAN_TOLERANCE),
            ("deviation of g over W", published.deviation, ours.deviation, DEVIATION_TOLERANCE),
        ):
            yield Claim(
                f"fig9-{name}-{what.split()[0]}",
                9,
                name,
                f"{what}: {theirs}",
                f"{value:.1f}",
                f"within {tolerance:g} g",
                abs(value - theirs) <= tolerance,
            )
    yield Claim(
        "fig9-spread",
        9,
        "both",
        "runs of one candidate differ more in Env1",
        f"deviation of g within a candidate, mean over W: {spreads['env1']:.1f} g in Env1, "
        f"{spreads['env2']:.1f} g in Env2",
        "larger in Env1",
        spreads["env1"] > spreads["env2"],
    )
    yield Claim(
        "fig9-area",
        9,
        "both",
        "high values over a wide area in Env1, only around w* in Env2",
        f"candidates with f above {ENV1_HIGH_VALUE:g} g: {high['env1']} in Env1, "
        f"{high['env2']} in Env2",
        "more in Env1",
        high["env1"] > high["env2"],
    )


def of_curves(results: Results, figure: int) -> Iterator[Claim]:
    """Fig. 10: ahead of the Baseline from query 30; Fig. 12: PBPO above PBPO without skip."""
    experiment = "certain" if figure == 10 else "uncertain"
    pairs = (
        (("pbpo", "knockout"), ("pbpo-no-skip", "knockout"))
        if figure == 10
        else (("pbpo", "pbpo-no-skip"),)
    )
    for environment in ENVIRONMENTS:
        for first, second in pairs:
            yield _ahead(results, figure, experiment, environment, first, second)


def of_violins(results: Results, figure: int) -> Iterator[Claim]:
    """Fig. 11 and 13: the tests after 40, 60 and 80 queries, medians and quartiles."""
    if figure == 11:
        yield from _of_certain(results)
    else:
        yield from _of_uncertain(results)


def _of_certain(results: Results) -> Iterator[Claim]:
    for (environment, queries), p in CERTAIN_P.items():
        pair = Pair(11, "certain", environment, "pbpo", "knockout", queries)
        yield better(pair, results, p)
    for environment in ENVIRONMENTS:
        for queries in VIOLIN_QUERIES:
            pair = Pair(11, "certain", environment, "pbpo", "pbpo-no-skip", queries)
            yield alike(pair, results)
    for queries in VIOLIN_QUERIES:
        yield _narrower(results, 11, "env1", "knockout", queries)
    world = results.worlds["env2"]
    for queries in (60, 80):
        medians = {
            method: float(np.median(results.after_queries("certain", "env2", method, queries)))
            for method in ("pbpo", "pbpo-no-skip")
        }
        best = float(world.f[world.best])
        yield Claim(
            f"fig11-env2-median-{queries}",
            11,
            "env2",
            f"medians of PBPO and PBPO w/o skip have reached f(w*) after {queries} queries",
            f"{medians['pbpo']:.1f} and {medians['pbpo-no-skip']:.1f}; f(w*) = {best:.1f}",
            "both medians equal f(w*)",
            all(abs(median - best) <= REACHED for median in medians.values()),
        )


def _of_uncertain(results: Results) -> Iterator[Claim]:
    for (environment, queries), p in UNCERTAIN_P.items():
        pair = Pair(13, "uncertain", environment, "pbpo", "pbpo-no-skip", queries)
        yield better(pair, results, p)
    for environment in ENVIRONMENTS:
        for queries in (60, 80):
            yield _narrower(results, 13, environment, "pbpo-no-skip", queries)
    for queries in VIOLIN_QUERIES:
        medians = {
            method: float(np.median(results.after_queries("uncertain", "env1", method, queries)))
            for method in ("pbpo", "pbpo-no-skip")
        }
        yield Claim(
            f"fig13-env1-median-{queries}",
            13,
            "env1",
            f"PBPO's median lies above that of PBPO w/o skip after {queries} queries",
            f"{medians['pbpo']:.1f} and {medians['pbpo-no-skip']:.1f}",
            "PBPO's median is higher",
            medians["pbpo"] > medians["pbpo-no-skip"],
        )


def _ahead(
    results: Results, figure: int, experiment: str, environment: str, first: str, second: str
) -> Claim:
    a, b = (results.mean_curve(experiment, environment, method) for method in (first, second))
    gaps = np.array(a)[AHEAD_FROM - 1 :] - np.array(b)[AHEAD_FROM - 1 :]
    return Claim(
        f"fig{figure}-{environment}-{first}-{second}",
        figure,
        environment,
        f"{label(first)} on average above {label(second)} from query {AHEAD_FROM} on",
        f"ahead at {np.count_nonzero(gaps > 0)} of {len(gaps)} queries; gap {gaps.min():+.1f} to "
        f"{gaps.max():+.1f} g, {gaps.mean():+.1f} on average",
        "ahead at each of these queries",
        bool((gaps > 0).all()),
    )


def _narrower(results: Results, figure: int, environment: str, other: str, queries: int) -> Claim:
    experiment = "certain" if figure == 11 else "uncertain"
    ranges = {
        method: interquartile_range(results.after_queries(experiment, environment, method, queries))
        for method in ("pbpo", other)
    }
    return Claim(
        f"fig{figure}-{environment}-range-{queries}",
        figure,
        environment,
        f"PBPO's interquartile range is narrower than that of {label(other)} after "
        f"{queries} queries",
        f"{ranges['pbpo']:.1f} and {ranges[other]:.1f} g",
        "PBPO's is narrower",
        ranges["pbpo"] < ranges[other],
    )
