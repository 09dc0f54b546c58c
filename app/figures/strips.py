"""Where values lie on one parameter after another, a row per group: for W that is no plane."""

from __future__ import annotations

from collections import Counter

import altair as alt

from .tables import Table, distinct, inline, require, where
from .theme import COLOURS, INK, panel_of, stacked


def strips(table: Table, *, y_title: str = "condition") -> alt.VConcatChart:
    """A panel per parameter; dots on one place become one larger dot.

    table: panel (the parameter's title), group, value; a row per thing that lies there.
    """
    require("strips", table, "panel", "group", "value")
    groups = distinct(table, "group")
    panels = []
    for panel in distinct(table, "panel"):
        counts = Counter((row["group"], row["value"]) for row in where(table, panel=panel))
        rows = [
            {"group": group, "value": value, "count": count}
            for (group, value), count in counts.items()
        ]
        size = alt.Size("count:Q", scale=alt.Scale(range=[30, 260]), legend=None)
        dots = (
            alt.Chart(inline(rows))
            .mark_point(filled=True, color=COLOURS["pbpo"], stroke=INK, opacity=0.75, aria=False)
            .encode(
                x=alt.X("value:Q", title=str(panel), scale=alt.Scale(zero=False)),
                y=alt.Y("group:N", sort=groups, title=y_title, axis=alt.Axis(grid=True)),
                size=size,
                tooltip=["group:N", "value:Q", "count:Q"],
            )
        )
        panels.append(panel_of([dots], "", width=420, height=max(60, 36 * len(groups))))
    return stacked(panels)
