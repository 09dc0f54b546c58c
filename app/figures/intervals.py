"""Values with their intervals, a row each: shares, win rates. A line marks what chance gives."""

from __future__ import annotations

import altair as alt

from .tables import Table, distinct, inline, require, where
from .theme import COLOURS, INK, QUIET, panel_of, stacked

#: Height of a row with its name, and of one among so many that names would not be read.
ROW_HEIGHT, THIN_ROW_HEIGHT = 22, 3
MOST_NAMED_ROWS = 40


def intervals(
    table: Table,
    *,
    x_title: str,
    y_title: str,
    reference: float | None = None,
    domain: tuple[float, float] | None = (0.0, 1.0),
    log: bool = False,
) -> alt.VConcatChart:
    """A dot and a bar per row, in the order of the table; a panel under the other.

    table: panel, name, value, low, high, number (what the value rests on).  domain: ends of the
    axis; None: from 0 to the largest value.  log: whether the axis is logarithmic.
    """
    require("intervals", table, "panel", "name", "value", "low", "high", "number")
    panels = []
    for panel in distinct(table, "panel"):
        rows = [
            {**row, **{end: round(row[end], 4) for end in ("value", "low", "high")}}
            for row in where(table, panel=panel)
        ]
        named = len(rows) <= MOST_NAMED_ROWS
        height = len(rows) * (ROW_HEIGHT if named else THIN_ROW_HEIGHT)
        axis = alt.Axis(labels=named, ticks=False, domain=False, labelLimit=260)
        base = alt.Chart(inline(rows)).encode(
            y=alt.Y("name:N", sort=None, title=y_title, axis=axis)
        )
        ends = (
            list(domain) if domain is not None else [0.0, max(row["high"] for row in rows) or 1.0]
        )
        scale = alt.Scale(domain=ends, type="log", nice=False) if log else alt.Scale(domain=ends)
        # Labels of a logarithmic axis lie close together at its upper ends of decades.
        across = alt.Axis(labelOverlap="greedy", labelSeparation=6) if log else alt.Axis()
        x = alt.X("value:Q", title=x_title, scale=scale, axis=across)
        bar = base.mark_rule(
            color=COLOURS["pbpo"], strokeWidth=2 if named else 1, opacity=0.6, aria=False
        ).encode(x=alt.X("low:Q", title=x_title), x2="high:Q")
        form = [alt.Tooltip(f"{end}:Q", format=".2f") for end in ("value", "low", "high")]
        dot = base.mark_point(
            filled=True, color=INK, size=40 if named else 14, opacity=1, aria=False
        ).encode(x=x, tooltip=["name:N", *form, "number:Q"])
        layers: list[alt.Chart] = []
        if reference is not None:
            layers.append(
                alt.Chart(inline([{"reference": reference}]))
                .mark_rule(strokeDash=[5, 4], color=QUIET)
                .encode(x="reference:Q")
            )
        panels.append(panel_of([*layers, bar, dot], str(panel), width=420, height=max(height, 40)))
    return stacked(panels)
