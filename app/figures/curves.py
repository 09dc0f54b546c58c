"""Mean curves (the paper's Fig. 10 and 12): what is acquired on average after each query."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import altair as alt
import numpy as np

from .tables import Row, Table, distinct, inline, require, where
from .theme import INK, QUIET, colour_scale, in_a_row, label, panel_of

#: Half the width of the band, in standard errors: 95 % of a normal distribution.
BAND_STANDARD_ERRORS: Final = 1.96


def mean_curves(
    table: Table,
    *,
    methods: Sequence[str],
    optimum: Mapping[str, float] | None = None,
    x_title: str = "two-choice queries",
    y_title: str = "f(w) acquired",
) -> alt.HConcatChart:
    """A curve per method, with a band of its 95 % interval; a panel per environment.

    table: panel, method, query (from 1 on), value; a row per trial and query. optimum: by panel.
    """
    require("mean curves", table, "panel", "method", "query", "value")
    scale = colour_scale(methods)
    panels = [
        _panel(
            str(panel),
            where(table, panel=panel),
            methods,
            scale,
            (optimum or {}).get(panel),
            (x_title, y_title),
        )
        for panel in distinct(table, "panel")
    ]
    return in_a_row(panels)


def _panel(
    panel: str,
    rows: list[Row],
    methods: Sequence[str],
    scale: alt.Scale,
    best: float | None,
    titles: tuple[str, str],
) -> alt.LayerChart:
    base = alt.Chart(inline(_means(rows, methods))).encode(
        x=alt.X("query:Q", title=titles[0]), color=alt.Color("method:N", scale=scale)
    )
    from_data = alt.Scale(zero=False)
    band = base.mark_area(opacity=0.15, aria=False).encode(
        y=alt.Y("low:Q", title=titles[1], scale=from_data), y2="high:Q"
    )
    line = base.mark_line(strokeWidth=2, aria=False).encode(
        y=alt.Y("mean:Q", title=titles[1], scale=from_data),
        tooltip=["method:N", "query:Q", alt.Tooltip("mean:Q", format=".1f"), "trials:Q"],
    )
    layers = [band, line, *([] if best is None else optimum_line(best))]
    return panel_of(layers, panel, width=330, height=240)


def optimum_line(value: float) -> list[alt.Chart]:
    """A dashed line at f(w*), with its name in the margin."""
    base = alt.Chart(inline([{"mean": value, "text": "f(w*)"}]))
    rule = base.mark_rule(strokeDash=[5, 4], color=INK).encode(y="mean:Q")
    text = base.mark_text(align="left", dx=4, color=QUIET, fontSize=11).encode(
        y="mean:Q", x=alt.value("width"), text="text:N"
    )
    return [rule, text]


def _means(rows: list[Row], methods: Sequence[str]) -> list[Row]:
    found: dict[tuple[str, int], list[float]] = {}
    for row in rows:
        found.setdefault((row["method"], row["query"]), []).append(row["value"])
    means: list[Row] = []
    for (method, query), values in sorted(
        found.items(), key=lambda item: (methods.index(item[0][0]), item[0][1])
    ):
        mean = float(np.mean(values))
        error = float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0
        means.append(
            {
                "method": label(method),
                "query": query,
                "mean": round(mean, 3),
                "low": round(mean - BAND_STANDARD_ERRORS * error, 3),
                "high": round(mean + BAND_STANDARD_ERRORS * error, 3),
                "trials": len(values),
            }
        )
    return means
