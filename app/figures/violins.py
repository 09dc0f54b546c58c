"""Violins with medians, quartiles and significance stars (the paper's Fig. 11, 13 and 17)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Final

import altair as alt
import numpy as np

from .curves import optimum_line
from .tables import Row, Table, distinct, inline, require, where
from .theme import INK, PAPER, colour_scale, in_a_row, label, panel_of

#: Widest half of a violin, where neighbours stand 1 apart.
HALF_WIDTH: Final = 0.4
#: Narrowest half, so that the thin neck to a lone value is still seen.
THINNEST: Final = 0.012
#: So many trials make a violin: the outline of fewer is an artefact of the kernel.
FEWEST_FOR_A_VIOLIN: Final = 8
POINTS: Final = 60  # heights at which a violin's outline is drawn
#: Narrowest kernel, as a share of what the panel spans: values that are all alike still show.
NARROWEST: Final = 0.01
#: Distance between brackets, and of the lowest from the violins, as a share of the panel's span.
BRACKET_STEP: Final = 0.08


def violins(
    table: Table,
    *,
    methods: Sequence[str],
    stars: Table = (),
    optimum: Mapping[str, float] | None = None,
    x_title: str = "two-choice queries",
    y_title: str = "f(w) acquired",
) -> alt.HConcatChart:
    """A violin per method and group; a panel per environment. White dot: median; bar: quartiles.

    Where a method has fewer than eight trials, they are drawn as dots instead.

    table: panel, group (queries so far), method, value; a row per trial. stars: panel, group,
    first, second, stars; a bracket for each row whose stars are not empty.
    """
    require("violins", table, "panel", "group", "method", "value")
    scale = colour_scale(methods)
    panels = []
    for panel in distinct(table, "panel"):
        rows = where(table, panel=panel)
        marks = where(stars, panel=panel)
        best = (optimum or {}).get(panel)
        panels.append(_panel(str(panel), rows, marks, methods, scale, best, (x_title, y_title)))
    return in_a_row(panels)


def outline(values: Sequence[float], bandwidth_floor: float) -> list[tuple[float, float]]:
    """(height, half width) from the least value to the largest; the widest is HALF_WIDTH.

    A Gaussian kernel with Scott's bandwidth, cut where the values end.
    """
    sample = np.asarray(values, dtype=np.float64)
    spread = float(sample.std(ddof=1)) if len(sample) > 1 else 0.0
    bandwidth = max(spread * len(sample) ** -0.2, bandwidth_floor)
    low, high = float(sample.min()), float(sample.max())
    if high - low < bandwidth_floor:
        low, high = low - bandwidth_floor / 2, high + bandwidth_floor / 2
    heights = np.linspace(low, high, POINTS)
    density = np.exp(-0.5 * ((heights[:, None] - sample) / bandwidth) ** 2).sum(axis=1)
    widths = np.maximum(HALF_WIDTH * density / density.max(), THINNEST)
    return [(float(h), float(w)) for h, w in zip(heights, widths, strict=True)]


def _panel(
    panel: str,
    rows: list[Row],
    stars: list[Row],
    methods: Sequence[str],
    scale: alt.Scale,
    best: float | None,
    titles: tuple[str, str],
) -> alt.LayerChart:
    groups = distinct(rows, "group")
    span = max(row["value"] for row in rows) - min(row["value"] for row in rows) or 1.0

    def place(group: object, method: str) -> float:
        return groups.index(group) * (len(methods) + 1.0) + methods.index(method)

    shapes: list[Row] = []
    bars: list[Row] = []
    dots: list[Row] = []
    for group in groups:
        for method in methods:
            values = [row["value"] for row in where(rows, group=group, method=method)]
            if not values:
                continue
            x = place(group, method)
            names = {"method": label(method), "violin": f"{group} {method}"}
            if len(values) < FEWEST_FOR_A_VIOLIN:
                dots += [
                    {**names, "x": x + shift, "value": round(value, 3)}
                    for value, shift in zip(values, _beside_each_other(values), strict=True)
                ]
                continue
            shapes += [
                {**names, "y": round(y, 3), "left": round(x - w, 4), "right": round(x + w, 4)}
                for y, w in outline(values, NARROWEST * span)
            ]
            low, median, high = (round(float(q), 3) for q in np.quantile(values, (0.25, 0.5, 0.75)))
            bars.append({**names, "x": x, "low": low, "median": median, "high": high})
    middles = {groups.index(g) * (len(methods) + 1.0) + (len(methods) - 1) / 2: g for g in groups}
    axis = alt.Axis(
        values=list(middles),
        labelExpr=json.dumps({f"{x:g}": str(g) for x, g in middles.items()}) + "[datum.value]",
        grid=False,
        ticks=False,
    )
    extent = alt.Scale(domain=[-0.8, len(groups) * (len(methods) + 1.0) - 1.2], nice=False)

    def across(field: str) -> alt.X:
        return alt.X(field, axis=axis, scale=extent, title=titles[0])

    violin = (
        alt.Chart(inline(shapes))
        .mark_area(orient="horizontal", opacity=0.75, aria=False)
        .encode(
            y=alt.Y("y:Q", title=titles[1], scale=alt.Scale(zero=False)),
            x=across("left:Q"),
            x2="right:Q",
            color=alt.Color("method:N", scale=scale),
            detail="violin:N",
        )
    )
    base = alt.Chart(inline(bars)).encode(x=across("x:Q"))
    quartiles = base.mark_rule(strokeWidth=4, color=INK, aria=False).encode(y="low:Q", y2="high:Q")
    median = base.mark_point(
        filled=True, fill=PAPER, stroke=INK, strokeWidth=1, size=34, opacity=1, aria=False
    ).encode(y="median:Q", tooltip=["method:N", "low:Q", "median:Q", "high:Q"])
    dot = (
        alt.Chart(inline(dots))
        .mark_point(filled=True, size=36, opacity=0.8, aria=False)
        .encode(
            x=across("x:Q"),
            y=alt.Y("value:Q", title=titles[1], scale=alt.Scale(zero=False)),
            color=alt.Color("method:N", scale=scale),
            tooltip=["method:N", "value:Q"],
        )
    )
    layers: list[alt.Chart] = [] if best is None else optimum_line(best)
    layers += [violin, quartiles, median] if shapes else []
    layers += [dot] if dots else []
    top = max([row["value"] for row in rows] + ([] if best is None else [best]))
    layers += _brackets(
        [
            {"low": place(m["group"], m["first"]), "high": place(m["group"], m["second"]), **m}
            for m in stars
            if m["stars"]
        ],
        top,
        span * BRACKET_STEP,
    )
    return panel_of(layers, panel, width=330, height=260)


def _beside_each_other(values: Sequence[float]) -> list[float]:
    """Shifts along x, so that no two dots of a method lie upon each other. Shape (n,)."""
    step = HALF_WIDTH / FEWEST_FOR_A_VIOLIN
    return [(place - (len(values) - 1) / 2) * step for place in range(len(values))]


def _brackets(marks: list[Row], top: float, step: float) -> list[alt.Chart]:
    """A line from method to method above the violins; those of one group above each other."""
    levels: dict[object, int] = {}
    rows: list[Row] = []
    for mark in marks:
        level = levels.get(mark["group"], 0) + 1
        levels[mark["group"]] = level
        left, right = sorted((mark["low"], mark["high"]))
        rows.append(
            {
                "x": left,
                "x2": right,
                "middle": (left + right) / 2,
                "y": top + level * step,
                "stars": mark["stars"],
            }
        )
    if not rows:
        return []
    base = alt.Chart(inline(rows)).encode(y="y:Q")
    rule = base.mark_rule(color=INK, aria=False).encode(x="x:Q", x2="x2:Q")
    text = base.mark_text(dy=-2, fontSize=14, color=INK).encode(x="middle:Q", text="stars:N")
    return [rule, text]
