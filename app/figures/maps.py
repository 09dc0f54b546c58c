"""Maps of a value over W, with points on them (the paper's Fig. 9, 19 and 20)."""

from __future__ import annotations

from typing import Final, Literal

import altair as alt

from app.figures.looks import INK, MAP_SCHEME, PAPER, panel_of, styled
from app.figures.tables import FigureDataError, Table, distinct, inline, require, where

#: Half the grid's step (paper section V-C): each candidate is the middle of its square.
HALF_STEP_S: Final = 0.025
#: By how much squares overlap, so that smoothing leaves no seams between them.
OVERLAP_S: Final = 0.0015
OPTIMUM_COLOUR: Final = "#e5383b"


def maps(
    table: Table,
    *,
    points: Table = (),
    optimum: Table = (),
    columns: int = 3,
    size: int = 190,
    value_title: str = "f(w)",
    shared: bool = True,
) -> alt.VConcatChart:
    """A panel per map, `columns` of them in a row.

    table: panel, w0, w1 (seconds), value. points: panel, w0, w1; those on one place become one
    larger dot. optimum: panel, w0, w1; framed in red. shared: whether all panels have one scale
    of values; a posterior of preferences has no unit, and needs its own.
    """
    require("maps", table, "panel", "w0", "w1", "value")
    for name, extra in (("points", points), ("optimum", optimum)):
        if extra:
            require(f"maps, {name}", extra, "panel", "w0", "w1")
    if columns < 1:
        raise FigureDataError(f"maps: expected columns from 1 on, got {columns!r}")
    panels = [
        _panel(
            str(panel),
            where(table, panel=panel),
            where(points, panel=panel),
            where(optimum, panel=panel),
            size,
            value_title,
        )
        for panel in distinct(table, "panel")
    ]
    colour: Literal["shared", "independent"] = "shared" if shared else "independent"
    scales = alt.Resolve(scale=alt.ScaleResolveMap(color=colour, size="independent"))
    lines = [
        alt.HConcatChart(hconcat=panels[at : at + columns], resolve=scales)
        for at in range(0, len(panels), columns)
    ]
    return styled(alt.VConcatChart(vconcat=lines, resolve=scales))


def _panel(
    panel: str, rows: Table, points: Table, optimum: Table, size: int, value_title: str
) -> alt.LayerChart:
    squares = [
        {
            "w0": round(row["w0"] - HALF_STEP_S, 3),
            "w1": round(row["w1"] - HALF_STEP_S, 3),
            "right": round(row["w0"] + HALF_STEP_S + OVERLAP_S, 4),
            "above": round(row["w1"] + HALF_STEP_S + OVERLAP_S, 4),
            "value": round(row["value"], 3),
        }
        for row in rows
    ]
    side = alt.Scale(domain=[-HALF_STEP_S, 1 + HALF_STEP_S], nice=False)
    axis = alt.Axis(values=[0, 0.2, 0.4, 0.6, 0.8, 1.0], format=".1f", grid=False)
    x = alt.X("w0:Q", scale=side, axis=axis, title="w0: opening time (s)")
    y = alt.Y("w1:Q", scale=side, axis=axis, title="w1: closing time (s)")
    legend = alt.Legend(
        title=value_title, orient="right", gradientLength=size - 40, titleFontWeight="normal"
    )
    heat = (
        alt.Chart(inline(squares))
        .mark_rect(aria=False)
        .encode(
            x=x,
            x2="right:Q",
            y=y,
            y2="above:Q",
            color=alt.Color("value:Q", scale=alt.Scale(scheme=MAP_SCHEME), legend=legend),
            tooltip=[alt.Tooltip("value:Q", format=".1f")],
        )
    )
    layers: list[alt.Chart] = [heat]
    if points:
        dots = alt.Chart(inline(_counted(points))).mark_point(
            filled=True, fill=PAPER, stroke=INK, strokeWidth=0.8, opacity=0.95, aria=False
        )
        layers.append(
            dots.encode(
                x=x,
                y=y,
                size=alt.Size(
                    "count:Q", scale=alt.Scale(domain=[1, 30], range=[18, 200]), legend=None
                ),
                tooltip=["w0:Q", "w1:Q", "count:Q"],
            )
        )
    if optimum:
        frame = alt.Chart(inline({"w0": r["w0"], "w1": r["w1"]} for r in optimum)).mark_point(
            shape="square",
            filled=False,
            stroke=OPTIMUM_COLOUR,
            strokeWidth=1.8,
            size=130,
            opacity=1,
        )
        layers.append(frame.encode(x=x, y=y))
    return panel_of(layers, panel, width=size, height=size)


def _counted(points: Table) -> Table:
    counts: dict[tuple[float, float], int] = {}
    for row in points:
        place = (row["w0"], row["w1"])
        counts[place] = counts.get(place, 0) + 1
    return [{"w0": w0, "w1": w1, "count": count} for (w0, w1), count in counts.items()]
