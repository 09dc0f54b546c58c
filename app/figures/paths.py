"""How something moved from query to query: a step line per parameter."""

from __future__ import annotations

import altair as alt

from .tables import Table, distinct, inline, require, where
from .theme import COLOURS, panel_of, stacked


def paths(table: Table, *, x_title: str = "query") -> alt.VConcatChart:
    """A panel per parameter, one under the other.

    table: panel (the parameter's title), query (from 1 on), value.
    """
    require("paths", table, "panel", "query", "value")
    panels = []
    for panel in distinct(table, "panel"):
        rows = [{"query": r["query"], "value": r["value"]} for r in where(table, panel=panel)]
        line = (
            alt.Chart(inline(rows))
            .mark_line(
                interpolate="step-after",
                color=COLOURS["pbpo"],
                aria=False,
                point=alt.OverlayMarkDef(size=16),
            )
            .encode(
                x=alt.X("query:Q", title=x_title),
                y=alt.Y("value:Q", title=str(panel), scale=alt.Scale(zero=False)),
                tooltip=["query:Q", "value:Q"],
            )
        )
        panels.append(panel_of([line], "", width=420, height=110))
    return stacked(panels)
