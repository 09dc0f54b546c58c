"""Counts per person, a dot per trial and a bar for the mean (the paper's Fig. 21)."""

from __future__ import annotations

import altair as alt
import numpy as np

from .tables import Table, distinct, inline, require, where
from .theme import COLOURS, INK, in_a_row, panel_of

#: So many people can be named below their bars.
FEW = 8
WIDEST = 420


def counts(
    table: Table, *, x_title: str = "evaluator", y_title: str = "skips in a trial"
) -> alt.HConcatChart:
    """A bar per person, as high as the mean, and a dot per trial; a panel per environment.

    table: panel, person, count; a row per trial.
    """
    require("counts", table, "panel", "person", "count")
    highest = max(row["count"] for row in table)
    y = alt.Y("count:Q", title=y_title, scale=alt.Scale(domain=[0, max(highest, 1)], nice=True))
    most = max(len(distinct(where(table, panel=p), "person")) for p in distinct(table, "panel"))
    few = most <= FEW
    width = 260 if few else min(WIDEST, most * 12)
    x = alt.X(
        "person:N",
        title=x_title,
        axis=alt.Axis(labelAngle=0, labels=few, ticks=few),
        sort=None,
    )
    panels = []
    for panel in distinct(table, "panel"):
        rows = where(table, panel=panel)
        means = [
            {
                "person": person,
                "count": round(float(np.mean([r["count"] for r in where(rows, person=person)])), 2),
            }
            for person in distinct(rows, "person")
        ]
        bar = (
            alt.Chart(inline(means))
            .mark_bar(color=COLOURS["pbpo"], opacity=0.35, size=30 if few else 0.7 * width / most)
            .encode(x=x, y=y)
        )
        dot = (
            alt.Chart(inline(rows))
            .mark_point(filled=True, color=INK, size=30 if few else 10, opacity=0.8)
            .encode(x=x, y=y)
        )
        panels.append(panel_of([bar, dot], str(panel), width=width, height=220))
    return in_a_row(panels)
