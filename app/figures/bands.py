"""The middle half of a value along a trial, with its median, such as response times by query."""

from __future__ import annotations

from collections.abc import Sequence

import altair as alt
import numpy as np

from .tables import Row, Table, distinct, inline, require, where
from .theme import colour_scale, in_a_row, label, panel_of


def bands(
    table: Table,
    *,
    methods: Sequence[str],
    x_title: str = "query",
    y_title: str,
    counted: str = "answers",
) -> alt.HConcatChart:
    """A line for the median and a band from quartile to quartile, per method; a panel each.

    table: panel, method, query (from 1 on), value; a row for each of what is `counted`.
    """
    require("bands", table, "panel", "method", "query", "value")
    scale = colour_scale(methods)
    panels = []
    for panel in distinct(table, "panel"):
        base = alt.Chart(inline(_quartiles(where(table, panel=panel), methods, counted))).encode(
            x=alt.X("query:Q", title=x_title), color=alt.Color("method:N", scale=scale)
        )
        band = base.mark_area(opacity=0.15, aria=False).encode(
            y=alt.Y("low:Q", title=y_title), y2="high:Q"
        )
        line = base.mark_line(strokeWidth=2, aria=False, point=alt.OverlayMarkDef(size=14)).encode(
            y=alt.Y("median:Q", title=y_title),
            tooltip=["method:N", "query:Q", "low:Q", "median:Q", "high:Q", f"{counted}:Q"],
        )
        panels.append(panel_of([band, line], str(panel), width=420, height=240))
    return in_a_row(panels)


def _quartiles(rows: list[Row], methods: Sequence[str], counted: str) -> list[Row]:
    found: dict[tuple[str, int], list[float]] = {}
    for row in rows:
        found.setdefault((row["method"], row["query"]), []).append(row["value"])
    quartiles: list[Row] = []
    for (method, query), values in sorted(
        found.items(), key=lambda item: (methods.index(item[0][0]), item[0][1])
    ):
        low, median, high = (round(float(q), 3) for q in np.quantile(values, (0.25, 0.5, 0.75)))
        quartiles.append(
            {
                "method": label(method),
                "query": query,
                "low": low,
                "median": median,
                "high": high,
                counted: len(values),
            }
        )
    return quartiles
