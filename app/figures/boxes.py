"""Boxes with the mean as a triangle and f(w*) as a dashed line (the paper's Fig. 18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import altair as alt
import numpy as np

from .curves import optimum_line
from .tables import Row, Table, distinct, inline, require, where
from .theme import INK, colour_scale, in_a_row, label, panel_of


def boxes(
    table: Table,
    *,
    methods: Sequence[str],
    optimum: Mapping[str, float] | None = None,
    y_title: str = "f(w) acquired",
) -> alt.HConcatChart:
    """A box per method; a panel per environment. Whiskers end within 1.5 times the box.

    table: panel, method, value; a row per trial. optimum: by panel.
    """
    require("boxes", table, "panel", "method", "value")
    scale = colour_scale(methods)
    panels = [
        _panel(str(panel), where(table, panel=panel), methods, scale, optimum or {}, y_title)
        for panel in distinct(table, "panel")
    ]
    return in_a_row(panels)


def _panel(
    panel: str,
    rows: list[Row],
    methods: Sequence[str],
    scale: alt.Scale,
    optimum: Mapping[str, float],
    y_title: str,
) -> alt.LayerChart:
    order = [label(method) for method in methods]
    x = alt.X("method:N", sort=order, title=None, axis=alt.Axis(labelAngle=0))
    y = alt.Y("mean:Q", title=y_title, scale=alt.Scale(zero=False))
    values = [{"method": label(row["method"]), "mean": round(row["value"], 3)} for row in rows]
    box = (
        alt.Chart(inline(values))
        .mark_boxplot(
            size=38,
            opacity=0.75,
            median={"color": INK, "size": 38, "thickness": 2},
            rule={"color": INK},
            ticks={"color": INK, "size": 14},
        )
        .encode(x=x, y=y, color=alt.Color("method:N", scale=scale, legend=None))
    )
    means = [
        {
            "method": label(method),
            "mean": round(float(np.mean([r["value"] for r in where(rows, method=method)])), 3),
        }
        for method in distinct(rows, "method")
    ]
    triangle = (
        alt.Chart(inline(means))
        .mark_point(
            shape="triangle-up", size=70, filled=True, fill="#ffffff", stroke=INK, opacity=1
        )
        .encode(x=x, y=y, tooltip=["method:N", "mean:Q"])
    )
    layers: list[alt.Chart] = optimum_line(optimum[panel]) if panel in optimum else []
    return panel_of([*layers, box, triangle], panel, width=250, height=240)
