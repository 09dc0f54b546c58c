"""The report of a reproduction: each published claim beside ours, its test, and a verdict.

`report.md` names its figures as `figures/...`, so that both can be put anywhere together.
"""

from __future__ import annotations

import csv
import io
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from types import MappingProxyType
from typing import Final

from app.figures import save

from . import claims_people, claims_simulated
from .claims import Claim
from .experiments import (
    CONVERGED_CRANE_RUNS,
    EXPERIMENTS,
    PEOPLE_QUERIES,
    SHARED_CRANE_RUNS,
    VIOLIN_QUERIES,
)
from .paper_figures import ABLATED, SIMULATED, plates
from .readings import CAPTIONS, READINGS
from .results import Results
from .setup import of_demanding, setup, summary
from .store import write_whole

_CLAIMS: Final[Mapping[int, Callable[[Results], Iterator[Claim]]]] = MappingProxyType(
    {
        9: claims_simulated.of_the_worlds,
        10: lambda results: claims_simulated.of_curves(results, 10),
        11: lambda results: claims_simulated.of_violins(results, 11),
        12: lambda results: claims_simulated.of_curves(results, 12),
        13: lambda results: claims_simulated.of_violins(results, 13),
        17: claims_people.of_ablation,
        18: claims_people.of_boxes,
        19: claims_people.of_acquired,
        20: claims_people.of_posteriors,
        21: claims_people.of_skips,
    }
)

LINE_LENGTH: Final = 95


def write_report(results: Results, figures: Sequence[int], folder: Path) -> Path:
    """Write figures, claims.csv and report.md into a folder; the report's path."""
    claims = {figure: list(_CLAIMS[figure](results)) for figure in figures}
    names: dict[int, list[str]] = {}
    for figure in figures:
        charts = plates(results, figure)
        for name, chart in charts.items():
            save(chart, folder / "figures", name)
        names[figure] = list(charts)
    write_whole(folder / "claims.csv", claims_table(claims).encode())
    path = folder / "report.md"
    write_whole(path, text(results, claims, names).encode())
    return path


def claims_table(claims: Mapping[int, Sequence[Claim]]) -> str:
    """All claims as CSV."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    columns = [field.name for field in fields(Claim)]
    writer.writerow(columns)
    for of_figure in claims.values():
        writer.writerows([asdict(claim)[name] for name in columns] for claim in of_figure)
    return file.getvalue()


def text(
    results: Results,
    claims: Mapping[int, Sequence[Claim]],
    names: Mapping[int, Sequence[str]],
) -> str:
    """The report, in Markdown."""
    parts = [*_opening(results, claims), *setup(results)]
    for figure, of_figure in claims.items():
        parts += _figure(results, figure, of_figure, names[figure])
    return "\n".join(parts).rstrip() + "\n"


def _opening(results: Results, claims: Mapping[int, Sequence[Claim]]) -> Iterator[str]:
    every = [claim for of_figure in claims.values() for claim in of_figure]
    held = Counter(claim.figure for claim in every if claim.holds)
    figures = ",".join(str(figure) for figure in claims)
    yield from (
        "# The paper's experiments, run again",
        "",
        "Written by `pbpo reproduce`, every table and figure from its results. The worlds are our",
        "own simulated ones, calibrated to the paper's published figures, and no person took part:",
        "where the paper asked people, simulated evaluators stand in for them, and say nothing",
        "about people.",
        "",
        "```",
        f"pbpo reproduce --figures {figures} --seed {results.seed} --out DIR",
        "```",
        "",
    )
    holding = sum(held.values())
    short = _short(results)
    if short:
        yield from (f"**Fewer trials than the paper: {short}. Verdicts mean little.**", "")
    yield from (
        f"Of {len(every)} claims, {holding} hold and {len(every) - holding} do not.",
        "",
        "| figure | claims | hold |",
        "|---|---|---|",
    )
    for figure, of_figure in claims.items():
        yield f"| {figure}: {CAPTIONS[figure]} | {len(of_figure)} | {held[figure]} |"
    yield from (
        "",
        "A claim of a significant difference holds when the same two-sample t-test as in the paper",
        "gives p < .05 in the same direction here; a claim of no difference holds when no test is",
        "significant. Beside p stand the difference of the means in grams with its 95 % interval",
        "(Welch) and Hedges' g. As in the paper, p is not corrected for the number of tests: of",
        "twenty tests without any difference one is expected below .05. A verdict near the",
        "threshold can turn with the seed. What we think of a figure stands below its tables; it",
        "was written after a run with seed 0, and appears only where the verdicts are the same.",
        "",
    )


def _short(results: Results) -> str:
    wanted = {experiment.name: experiment.trials for experiment in EXPERIMENTS}
    fewest: dict[str, int] = {}
    for (experiment, _, _), count in results.counts().items():
        fewest[experiment] = min(count, fewest.get(experiment, count))
    return ", ".join(
        f"{count} of {wanted[name]} ({name})"
        for name, count in fewest.items()
        if count < wanted.get(name, 0)
    )


def _figure(
    results: Results, figure: int, claims: Sequence[Claim], names: Sequence[str]
) -> Iterator[str]:
    yield from (f"## Figure {figure}: {CAPTIONS[figure]}", "")
    for name in names:
        yield from (f"![{CAPTIONS[figure]}](figures/{name}.svg)", "")
    yield from (
        "| | the paper | here | holds when | verdict |",
        "|---|---|---|---|---|",
    )
    for claim in claims:
        yield (
            f"| {claim.environment} | {_cell(claim.published)} | {_cell(claim.ours)} | "
            f"{_cell(claim.rule)} | {'' if claim.holds else '**'}{claim.verdict}"
            f"{'' if claim.holds else '**'} |"
        )
    yield ""
    yield from _beside(results, figure)
    for reading in READINGS.get(figure, ()):
        if reading.applies({claim.name: claim.holds for claim in claims}):
            yield from (textwrap.fill(reading.text, LINE_LENGTH), "")


def _beside(results: Results, figure: int) -> Iterator[str]:
    """Figures of the paper beside ours that no verdict is passed on."""
    if figure in (11, 13):
        experiment = "certain" if figure == 11 else "uncertain"
        yield from summary(results, experiment, SIMULATED, VIOLIN_QUERIES)
    if figure == 13:
        yield from of_demanding(results, VIOLIN_QUERIES)
    if figure == 17:
        yield from summary(results, "people", ABLATED, PEOPLE_QUERIES)
    if figure == 18:
        for environment, at_both in zip(
            ("Env1", "Env2"), claims_people.at_shared_runs(results), strict=True
        ):
            yield (
                f"- {environment}, mean f after {SHARED_CRANE_RUNS} and after "
                f"{CONVERGED_CRANE_RUNS} crane runs: {at_both}."
            )
        yield ""
    if figure == 20:
        for environment, (published, ours) in zip(
            ("Env1", "Env2"), claims_people.extremes(results), strict=True
        ):
            yield f"- {environment}, best and worst of PBPO. Paper: {published}. Here: {ours}."
        yield ""


def _cell(words: str) -> str:
    return words.replace("|", "\\|")
