"""Charts of people judged together, for the page, files and the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from app.figures import intervals, maps, scatters, side, slices
from app.services.pooling.people import DIFFERS
from app.services.studies.repository import StudyInfo

from .charts import Chart, axis_title
from .result import Result, Row

#: Panels of the population's map, and the column of each.
_PANELS: Final = {
    "What people like": "posterior_mean",
    "How unsure": "posterior_std",
    "Where people disagree": "disagreement",
}
#: The panel on which people's own bests lie.
_BESTS_ON: Final = "What people like"


def draw_people(name: str, found: Result, study: StudyInfo) -> Chart:
    """The chart of a result that has rows. name: a key of PEOPLE_FINDINGS."""
    return _DRAWN[name](found, study)


def _population(found: Result, study: StudyInfo) -> Chart:
    parameters = study.plan.parameters
    best = found.rows[found.extra["best"]]
    titles = {parameter.name: axis_title(parameter, study) for parameter in parameters}
    if len(parameters) != 2:
        return slices(
            [row for name, title in titles.items() for row in _along(found, name, title)],
            points=[
                {"panel": title, "value": at[name]}
                for name, title in titles.items()
                for at in found.extra["bests"]
            ],
            optimum=[{"panel": title, "value": best[name]} for name, title in titles.items()],
        )
    across, up = (
        side(name, title, [row[name] for row in found.rows]) for name, title in titles.items()
    )
    return maps(
        [
            {
                "panel": panel,
                across.column: row[across.column],
                up.column: row[up.column],
                "value": row[column],
            }
            for panel, column in _PANELS.items()
            for row in found.rows
        ],
        points=[{"panel": _BESTS_ON, **at} for at in found.extra["bests"]],
        optimum=[
            {"panel": panel, across.column: best[across.column], up.column: best[up.column]}
            for panel in _PANELS
        ],
        size=175,
        sides=(across, up),
        value_title="",
        value_format=".3~g",
        shared=False,
    )


def _along(found: Result, name: str, title: str) -> list[Row]:
    """The mean of the population's values and deviations at each value of a parameter."""
    at: dict[float, list[Row]] = {}
    for row in found.rows:
        at.setdefault(row[name], []).append(row)
    rows: list[Row] = []
    for value, there in at.items():
        mean = sum(row["posterior_mean"] for row in there) / len(there)
        std = sum(row["posterior_std"] for row in there) / len(there)
        rows.append(
            {"panel": title, "value": value, "mean": mean, "low": mean - std, "high": mean + std}
        )
    return rows


def _taste_and_reliability(found: Result, _study: StudyInfo) -> Chart:
    return scatters(
        [
            {
                "name": row["participant_id"],
                "x": row["costs"],
                "y": row["noise"],
                "marked": row["flagged"],
            }
            for row in found.rows
        ],
        x_title="costs of the population's best, as a share of the own range",
        y_title="noise (1 is usual)",
        marked_title="flagged",
        other_title="not flagged",
        x_reference=DIFFERS,
        y_reference=1.0,
    )


def _noise(found: Result, _study: StudyInfo) -> Chart:
    return intervals(
        [
            {
                "panel": "",
                "name": row["participant_id"],
                "value": row["noise"],
                "low": row["low"],
                "high": row["high"],
                "number": row["answers"],
            }
            for row in found.rows
        ],
        x_title="noise (1 is usual)",
        y_title="person",
        reference=1.0,
        domain=(0.5, 12.0),
        log=True,
    )


def _influence(found: Result, _study: StudyInfo) -> Chart:
    return intervals(
        [
            {
                "panel": "",
                "name": row["participant_id"],
                "value": row["influence"],
                "low": 0.0,
                "high": row["influence"],
                "number": row["answers"],
            }
            for row in found.rows
        ],
        x_title="change of the population's values",
        y_title="person",
        domain=None,
    )


_DRAWN: Final[Mapping[str, Callable[[Result, StudyInfo], Chart]]] = MappingProxyType(
    {
        "population": _population,
        "taste-and-reliability": _taste_and_reliability,
        "noise": _noise,
        "influence": _influence,
    }
)
