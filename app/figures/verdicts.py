"""Which claims hold under which setting: a row per claim, a column per setting."""

from __future__ import annotations

import altair as alt

from .tables import Table, distinct, inline, require, where
from .theme import COLOURS, INK, in_a_row, panel_of

#: Points per column and per row.
COLUMN = 34
ROW = 15


def verdicts(table: Table, *, x_title: str) -> alt.HConcatChart:
    """A filled square where a claim holds, a small dot where it does not; a panel per group.

    table: panel, claim, setting, holds (true or false); a row per claim and setting, in order.
    """
    require("verdicts", table, "panel", "claim", "setting", "holds")
    panels = []
    for panel in distinct(table, "panel"):
        rows = where(table, panel=panel)
        x = alt.X("setting:N", title=x_title, sort=None, axis=alt.Axis(labelAngle=0))
        y = alt.Y("claim:N", title=None, sort=None, axis=alt.Axis(labelLimit=600))
        held = (
            alt.Chart(inline(where(rows, holds=True)))
            .mark_square(filled=True, color=COLOURS["pbpo"], size=110, opacity=1)
            .encode(x=x, y=y)
        )
        not_held = (
            alt.Chart(inline(where(rows, holds=False)))
            .mark_point(filled=True, color=INK, size=10, opacity=0.5)
            .encode(x=x, y=y)
        )
        # All rows first: an axis keeps the order in which it meets its values.
        order = alt.Chart(inline(rows)).mark_point(opacity=0).encode(x=x, y=y)
        width = COLUMN * len(distinct(rows, "setting"))
        height = ROW * len(distinct(rows, "claim"))
        panels.append(panel_of([order, not_held, held], str(panel), width=width, height=height))
    return in_a_row(panels)
