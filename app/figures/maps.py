"""Maps of a value over W, with points on them (the paper's Fig. 9, 19 and 20)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Literal, TypeVar

import altair as alt

from .tables import FigureDataError, Row, Table, distinct, inline, require, where
from .theme import INK, MAP_SCHEME, PAPER, panel_of, styled

#: Half the grid's step (paper section V-C): each candidate is the middle of its square.
HALF_STEP_S: Final = 0.025
#: By how much squares overlap, so that smoothing leaves no seams between them.
OVERLAP_S: Final = 0.0015
OPTIMUM_COLOUR: Final = "#e5383b"
#: Values beyond these many on one side are no grid's: each candidate is a small square of its own.
MOST_STEPS: Final = 60
#: Decimals by which values are told apart: 0.1 + 0.05 is 0.15.
DIGITS: Final = 9
#: Half of that square's width, as a share of the side.
HALF_SQUARE: Final = 0.012


@dataclass(frozen=True)
class Side:
    """One side of W: its parameter's column and title, and what each value's square covers.

    squares: by value, its low and its high end. ticks: where the axis is marked, None for anywhere.
    """

    column: str
    title: str
    squares: dict[float, tuple[float, float]] = field(default_factory=dict)
    ticks: tuple[float, ...] | None = None

    def square(self, value: float) -> tuple[float, float]:
        """What the square of a candidate of this value covers."""
        return self.squares[round(value, DIGITS)]

    @property
    def domain(self) -> list[float]:
        ends = [end for square in self.squares.values() for end in square]
        return [min(ends), max(ends)]


def side(column: str, title: str, values: Iterable[float]) -> Side:
    """The side of a parameter with these values: squares meet half-way between neighbours."""
    steps = sorted({round(value, DIGITS) for value in values})
    if not steps:
        raise FigureDataError(f"maps: expected values of {column}, got none")
    span = steps[-1] - steps[0] or 1.0
    if len(steps) > MOST_STEPS or len(steps) == 1:
        half = span * HALF_SQUARE
        return Side(column, title, {step: (step - half, step + half) for step in steps})
    middles = [(a + b) / 2 for a, b in pairwise(steps)]
    lows = [2 * steps[0] - middles[0], *middles]
    highs = [*middles, 2 * steps[-1] - middles[-1]]
    return Side(column, title, dict(zip(steps, zip(lows, highs, strict=True), strict=True)))


def _crane(column: str, title: str) -> Side:
    steps = [round(2 * HALF_STEP_S * step, 2) for step in range(21)]
    squares = {step: (round(step - HALF_STEP_S, 3), round(step + HALF_STEP_S, 3)) for step in steps}
    return Side(column, title, squares, (0, 0.2, 0.4, 0.6, 0.8, 1.0))


#: W of the shipped crane, as the paper draws it.
CRANE: Final = (_crane("w0", "w0: opening time (s)"), _crane("w1", "w1: closing time (s)"))


def maps(
    table: Table,
    *,
    points: Table = (),
    optimum: Table = (),
    columns: int = 3,
    size: int = 190,
    value_title: str = "f(w)",
    shared: bool = True,
    sides: tuple[Side, Side] = CRANE,
    value_format: str = ".1f",
) -> alt.VConcatChart:
    """A panel per map, `columns` of them in a row.

    table: panel, value, and a column for each of the two sides. points: panel and the sides; those
    on one place become one larger dot. optimum: the same; framed in red. shared: whether all panels
    have one scale of values; a posterior of preferences has no unit, and needs its own.
    """
    across, up = (side.column for side in sides)
    require("maps", table, "panel", across, up, "value")
    for name, extra in (("points", points), ("optimum", optimum)):
        if extra:
            require(f"maps, {name}", extra, "panel", across, up)
    if columns < 1:
        raise FigureDataError(f"maps: expected columns from 1 on, got {columns!r}")
    panels = [
        _panel(
            str(panel),
            where(table, panel=panel),
            where(points, panel=panel),
            where(optimum, panel=panel),
            size,
            (value_title, value_format),
            sides,
        )
        for panel in distinct(table, "panel")
    ]
    colour: Literal["shared", "independent"] = "shared" if shared else "independent"
    scales = alt.Resolve(scale=alt.ScaleResolveMap(color=colour, size="independent"))
    lines = [
        alt.HConcatChart(hconcat=panels[at : at + columns], resolve=scales)
        for at in range(0, len(panels), columns)
    ]
    return styled(alt.VConcatChart(vconcat=lines, resolve=scales))


def _panel(
    panel: str,
    rows: Table,
    points: Table,
    optimum: Table,
    size: int,
    value: tuple[str, str],
    sides: tuple[Side, Side],
) -> alt.LayerChart:
    across, up = sides
    squares = [
        {
            "x": across.square(row[across.column])[0],
            "y": up.square(row[up.column])[0],
            "right": _beyond(across, row),
            "above": _beyond(up, row),
            "value": float(f"{row['value']:.5g}"),
            across.column: row[across.column],
            up.column: row[up.column],
        }
        for row in rows
    ]
    x, y = _axis(alt.X("x:Q"), across), _axis(alt.Y("y:Q"), up)
    legend = alt.Legend(
        title=value[0], orient="right", gradientLength=size - 40, titleFontWeight="normal"
    )
    heat = (
        alt.Chart(inline(squares))
        .mark_rect(aria=False)
        .encode(
            x=x,
            x2="right:Q",
            y=y,
            y2="above:Q",
            color=alt.Color("value:Q", scale=alt.Scale(scheme=MAP_SCHEME), legend=legend),
            tooltip=[
                f"{across.column}:Q",
                f"{up.column}:Q",
                alt.Tooltip("value:Q", format=value[1]),
            ],
        )
    )
    layers: list[alt.Chart] = [heat]
    if points:
        dots = alt.Chart(inline(_counted(points, sides))).mark_point(
            filled=True, fill=PAPER, stroke=INK, strokeWidth=0.8, opacity=0.95, aria=False
        )
        layers.append(
            dots.encode(
                x=x,
                y=y,
                size=alt.Size(
                    "count:Q", scale=alt.Scale(domain=[1, 30], range=[18, 200]), legend=None
                ),
                tooltip=[
                    alt.Tooltip("x:Q", title=across.column),
                    alt.Tooltip("y:Q", title=up.column),
                    "count:Q",
                ],
            )
        )
    if optimum:
        frame = alt.Chart(
            inline({"x": r[across.column], "y": r[up.column]} for r in optimum)
        ).mark_point(
            shape="square",
            filled=False,
            stroke=OPTIMUM_COLOUR,
            strokeWidth=1.8,
            size=130,
            opacity=1,
        )
        layers.append(frame.encode(x=x, y=y))
    return panel_of(layers, panel, width=size, height=size)


def _beyond(side: Side, row: Row) -> float:
    """The far end of a row's square, a little over its neighbour's near end."""
    near, far = side.square(row[side.column])
    overlap = OVERLAP_S / (2 * HALF_STEP_S) * (far - near)
    return round(far + overlap, 6)


AxisOf = TypeVar("AxisOf", alt.X, alt.Y)


def _axis(encoded: AxisOf, side: Side) -> AxisOf:
    ticks = alt.Undefined if side.ticks is None else list(side.ticks)
    form = alt.Undefined if side.ticks is None else ".1f"
    result: AxisOf = (
        encoded.scale(alt.Scale(domain=side.domain, nice=False, zero=False))
        .axis(alt.Axis(values=ticks, format=form, grid=False))
        .title(side.title)
    )
    return result


def _counted(points: Table, sides: tuple[Side, Side]) -> Table:
    counts = Counter((row[sides[0].column], row[sides[1].column]) for row in points)
    return [{"x": x, "y": y, "count": count} for (x, y), count in counts.items()]
