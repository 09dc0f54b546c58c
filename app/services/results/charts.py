"""Draws the charts of results with app.figures, for pages, files and reports."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from app.figures import bands, counts, intervals, maps, paths, side, slices, strips, violins
from app.services.studies.repository import StudyInfo
from app.study.search_space import Parameter

from .candidate_words import label
from .result import Result, Row

#: Any Altair chart.
Chart = Any


def draw(name: str, found: Result, study: StudyInfo) -> Chart:
    """The chart of a result that has rows. name: a key of FINDINGS or LEARNING."""
    return _DRAWN[name](found, study)


def axis_title(parameter: Parameter, study: StudyInfo) -> str:
    """The axis title of a parameter: its label as the study writes it, with its unit."""
    named = label(parameter, study.plan)
    return f"{named} ({parameter.unit})" if parameter.unit else named


def _conditions(rows: Sequence[Row], study: StudyInfo) -> list[str]:
    """The conditions in the rows: in the order of the plan, then those of earlier plans."""
    present = dict.fromkeys(row["condition"] for row in rows)
    planned = [condition.name for condition in study.plan.conditions]
    known = [name for name in planned if name in present]
    return known + [name for name in present if name not in known]


def _on_w(found: Result, study: StudyInfo) -> Chart:
    parameters = study.plan.parameters
    if len(parameters) != 2:
        return strips(
            [
                {
                    "panel": axis_title(parameter, study),
                    "group": row["condition"],
                    "value": row[parameter.name],
                }
                for parameter in parameters
                for row in found.rows
            ]
        )
    points: Mapping[tuple[str, int], Sequence[float]] = found.extra["points"]
    across, up = (
        side(p.name, axis_title(p, study), [at[place] for at in points.values()])
        for place, p in enumerate(parameters)
    )
    ground: list[Row] = []
    dots: list[Row] = []
    for condition in _conditions(found.rows, study):
        rows = [row for row in found.rows if row["condition"] == condition]
        environment = rows[0]["environment"]
        ground += [
            {
                "panel": condition,
                across.column: points[key][0],
                up.column: points[key][1],
                "value": value,
            }
            for key, value in found.extra["ground"].items()
            if key[0] == environment
        ]
        dots += [
            {"panel": condition, across.column: row[across.column], up.column: row[up.column]}
            for row in rows
        ]
    return maps(
        ground,
        points=dots,
        sides=(across, up),
        value_title=found.extra["ground_title"],
        value_format=".3~g",
    )


def _scores(found: Result, study: StudyInfo) -> Chart:
    unit = found.extra["unit"]
    rows = [
        {
            "panel": row["environment"],
            "group": row["answers"],
            "method": row["condition"],
            "value": row["score"],
        }
        for row in sorted(found.rows, key=lambda row: row["answers"])
    ]
    return violins(
        rows,
        methods=_conditions(found.rows, study),
        stars=found.extra["tests"],
        x_title="answers that the method learned from",
        y_title=f"score of what was acquired ({unit})" if unit else "score of what was acquired",
    )


def _sureness(found: Result, study: StudyInfo) -> Chart:
    return bands(
        [
            {
                "panel": "",
                "method": row["condition"],
                "query": row["answers"],
                "value": row["sureness"],
            }
            for row in found.rows
        ],
        methods=_conditions(found.rows, study),
        x_title="answers that the method learned from",
        y_title="probability that it is good enough",
        counted="trials",
    )


def _skips(found: Result, _study: StudyInfo) -> Chart:
    rows = sorted(found.rows, key=lambda row: row["skips"])
    return counts(
        [
            {"panel": row["condition"], "person": row["participant_id"], "count": row["skips"]}
            for row in rows
        ]
    )


def _times(found: Result, study: StudyInfo) -> Chart:
    return bands(
        [
            {
                "panel": "",
                "method": row["condition"],
                "query": row["query_index"] + 1,
                "value": row["rt_ms"] / 1000,
            }
            for row in found.rows
        ],
        methods=_conditions(found.rows, study),
        x_title="query of the trial",
        y_title="seconds to the answer",
    )


def _dots(
    x_title: str, y_title: str, panel: str, name: Callable[[Row], str], value: str, number: str
) -> Callable[[Result, StudyInfo], Chart]:
    def drawn(found: Result, _study: StudyInfo) -> Chart:
        rows = [
            {
                "panel": row.get(panel, ""),
                "name": name(row),
                "value": row[value],
                "low": row["low"],
                "high": row["high"],
                "number": row[number],
            }
            for row in found.rows
        ]
        return intervals(rows, x_title=x_title, y_title=y_title, reference=0.5)

    return drawn


def _path(found: Result, study: StudyInfo) -> Chart:
    return paths(
        [
            {
                "panel": axis_title(parameter, study),
                "query": row["query_index"] + 1,
                "value": row[parameter.name],
            }
            for parameter in study.plan.parameters
            for row in found.rows
        ]
        + [
            {"panel": "how sure", "query": row["query_index"] + 1, "value": row["sureness"]}
            for row in found.rows
            if row["sureness"] is not None
        ],
        x_title="answers",
    )


def _posterior(found: Result, study: StudyInfo) -> Chart:
    """Two maps if W is two-dimensional; otherwise the mean along each parameter."""
    parameters = study.plan.parameters
    best, ground = found.extra["best"], found.extra["ground"]
    shown = [row for row in found.rows if row["times_shown"]]
    if len(parameters) != 2:
        titles = {p.name: axis_title(p, study) for p in parameters}
        return slices(
            [row for name, title in titles.items() for row in _along(ground, name, title)],
            points=[
                {"panel": title, "value": row[name]}
                for name, title in titles.items()
                for row in shown
            ],
            optimum=[{"panel": title, "value": best[name]} for name, title in titles.items()],
        )
    across, up = (
        side(p.name, axis_title(p, study), [row[p.name] for row in ground]) for p in parameters
    )
    panels = {"Posterior mean": "posterior_mean", "Its uncertainty": "posterior_std"}

    def placed(row: Row, panel: str) -> Row:
        return {"panel": panel, across.column: row[across.column], up.column: row[up.column]}

    return maps(
        [
            {**placed(row, panel), "value": row[column]}
            for panel, column in panels.items()
            for row in ground
        ],
        points=[
            placed(row, panel)
            for panel in panels
            for row in shown
            for _ in range(row["times_shown"])
        ],
        optimum=[placed(best, panel) for panel in panels],
        columns=2,
        size=175,
        sides=(across, up),
        value_title="",
        value_format=".3~g",
        shared=False,
    )


def _along(rows: Sequence[Row], name: str, title: str) -> list[Row]:
    """The mean over the rows of each value of the parameter, of those along it where some are."""
    means: dict[float, list[Row]] = {}
    for row in rows:
        if row.get("varies") in (None, name):
            means.setdefault(row[name], []).append(row)
    found: list[Row] = []
    for value, there in means.items():
        mean = sum(row["posterior_mean"] for row in there) / len(there)
        std = sum(row["posterior_std"] for row in there) / len(there)
        found.append(
            {"panel": title, "value": value, "mean": mean, "low": mean - std, "high": mean + std}
        )
    return found


_DRAWN: Final[Mapping[str, Callable[[Result, StudyInfo], Chart]]] = MappingProxyType(
    {
        "acquired-on-w": _on_w,
        "acquired-scores": _scores,
        "how-sure": _sureness,
        "win-rates": _dots(
            "wins against the average",
            "candidate",
            "environment",
            lambda row: str(row["candidate"]),
            "win_rate",
            "comparisons",
        ),
        "skips": _skips,
        "response-times": _times,
        "sides": _dots(
            "share of choices on the left",
            "session",
            "",
            lambda row: str(row["session_id"]),
            "share_left",
            "choices",
        ),
        "repeats": _dots(
            "answered alike",
            "condition",
            "",
            lambda row: str(row["condition"]),
            "agreement",
            "repeats",
        ),
        "path": _path,
        "posterior": _posterior,
    }
)
