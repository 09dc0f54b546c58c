"""One dot per person on two axes: what is two questions at once, such as taste and reliability."""

from __future__ import annotations

from typing import Final

import altair as alt

from .tables import Table, inline, require
from .theme import COLOURS, INK, QUIET, panel_of, stacked

#: Dots of a few people, and of so many that they would cover each other.
DOT_SIZE, SMALL_DOT_SIZE = 90, 36
MOST_LARGE_DOTS = 40
#: Room beside the outermost dots, as a share of the axis.
MARGIN: Final = 0.05
#: The colour of dots that are marked.
MARKED = COLOURS["pbpo-no-skip"]


def scatters(
    table: Table,
    *,
    x_title: str,
    y_title: str,
    marked_title: str,
    other_title: str,
    x_reference: float | None = None,
    y_reference: float | None = None,
) -> alt.VConcatChart:
    """A dot per row; marked ones are diamonds in another colour. The vertical axis is logarithmic.

    table: name, x, y (above 0), marked.  x_reference, y_reference: dashed lines.
    """
    require("scatters", table, "name", "x", "y", "marked")
    rows = [
        {
            "name": row["name"],
            "x": round(row["x"], 4),
            "y": round(row["y"], 4),
            "kind": marked_title if row["marked"] else other_title,
        }
        for row in table
    ]
    kinds = [other_title, marked_title]
    # Dots at an end are drawn whole.
    rightmost = max([row["x"] for row in rows] + [x_reference or 0.0]) or 1.0
    across = alt.Scale(domain=[-MARGIN * rightmost, (1.0 + MARGIN) * rightmost], nice=False)
    heights = [row["y"] for row in rows] + [y_reference or rows[0]["y"]]
    up = alt.Scale(type="log", domain=[min(heights) / 1.3, max(heights) * 1.3], nice=False)
    x, y = alt.X("x:Q", title=x_title, scale=across), alt.Y("y:Q", title=y_title, scale=up)
    layers: list[alt.Chart] = []
    if x_reference is not None:
        layers.append(
            alt.Chart(inline([{"at": x_reference}]))
            .mark_rule(strokeDash=[5, 4], color=QUIET, aria=False)
            .encode(x=alt.X("at:Q", title=x_title))
        )
    if y_reference is not None:
        layers.append(
            alt.Chart(inline([{"at": y_reference}]))
            .mark_rule(strokeDash=[5, 4], color=QUIET, aria=False)
            .encode(y=alt.Y("at:Q", title=y_title))
        )
    few = len(rows) <= MOST_LARGE_DOTS
    layers.append(
        alt.Chart(inline(rows))
        .mark_point(
            filled=True,
            stroke=INK,
            strokeWidth=0.5,
            opacity=0.8,
            size=DOT_SIZE if few else SMALL_DOT_SIZE,
            aria=False,
        )
        .encode(
            x=x,
            y=y,
            color=alt.Color(
                "kind:N", scale=alt.Scale(domain=kinds, range=[COLOURS["pbpo"], MARKED])
            ),
            shape=alt.Shape("kind:N", scale=alt.Scale(domain=kinds, range=["circle", "diamond"])),
            tooltip=["name:N", "x:Q", "y:Q"],
        )
    )
    return stacked([panel_of(layers, "", width=420, height=260)])
