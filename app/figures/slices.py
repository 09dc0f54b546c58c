"""A posterior along one parameter after another: its mean with a band of one deviation."""

from __future__ import annotations

import altair as alt

from .maps import OPTIMUM_COLOUR
from .tables import Table, distinct, inline, require, where
from .theme import COLOURS, INK, in_a_row, panel_of


def slices(table: Table, *, points: Table = (), optimum: Table = ()) -> alt.HConcatChart:
    """A panel per parameter, side by side.

    table: panel (the parameter's title), value, mean, low, high. points: panel, value; marks at
    the foot. optimum: panel, value; a red line.
    """
    require("slices", table, "panel", "value", "mean", "low", "high")
    panels = []
    for panel in distinct(table, "panel"):
        rows = [
            {name: float(f"{row[name]:.5g}") for name in ("value", "mean", "low", "high")}
            for row in where(table, panel=panel)
        ]
        base = alt.Chart(inline(sorted(rows, key=lambda row: row["value"]))).encode(
            x=alt.X("value:Q", title=str(panel), scale=alt.Scale(zero=False))
        )
        band = base.mark_area(opacity=0.18, color=COLOURS["pbpo"], aria=False).encode(
            y=alt.Y("low:Q", title="posterior mean, and one deviation"), y2="high:Q"
        )
        line = base.mark_line(
            color=COLOURS["pbpo"], aria=False, point=alt.OverlayMarkDef(size=18)
        ).encode(y="mean:Q", tooltip=["value:Q", "mean:Q", "low:Q", "high:Q"])
        layers = [band, line]
        asked = {row["value"] for row in where(points, panel=panel)}
        if asked:
            layers.append(
                alt.Chart(inline({"value": value} for value in sorted(asked)))
                .mark_tick(color=INK, thickness=1.5, size=9, yOffset=-5, aria=False)
                .encode(x="value:Q", y=alt.value("height"))
            )
        best = where(optimum, panel=panel)
        if best:
            layers.append(
                alt.Chart(inline({"value": row["value"]} for row in best))
                .mark_rule(color=OPTIMUM_COLOUR, strokeWidth=1.5, aria=False)
                .encode(x="value:Q")
            )
        panels.append(panel_of(layers, "", width=260, height=220))
    return in_a_row(panels)
