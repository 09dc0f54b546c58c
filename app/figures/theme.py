"""How figures look: names and colours of the methods, type, ink.

Colours are far apart in hue and in lightness, so that they stay apart for colour-blind readers and
in grey print.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, TypeVar

import altair as alt

INK: Final = "#1c1f24"
PAPER: Final = "#ffffff"
QUIET: Final = "#8a919c"
GRID: Final = "#eceef1"
FONT: Final = "system-ui, 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif"

LABELS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "pbpo": "PBPO",
        "pbpo-no-synthesis": "PBPO w/o synthesis",
        "pbpo-no-skip": "PBPO w/o skip",
        "knockout": "Baseline (knockout)",
        "rbo": "RBO",
        "bo": "BO",
    }
)
COLOURS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "pbpo": "#1d5fc2",
        "pbpo-no-synthesis": "#2f9e77",
        "pbpo-no-skip": "#d9822b",
        "knockout": "#6b7280",
        "rbo": "#8e5bb5",
        "bo": "#b5485d",
    }
)
#: For methods that the paper does not have.
OTHER_COLOURS: Final = ("#0f8b9d", "#a0741c", "#4b4fa3", "#7a8f2a")

#: Values of f and g from low to high: even in lightness, unlike the paper's blue to red.
MAP_SCHEME: Final = "viridis"

Concatenated = TypeVar("Concatenated", alt.HConcatChart, alt.VConcatChart)


def label(method: str) -> str:
    """A method's name for readers."""
    return LABELS.get(method, method)


def colour_scale(methods: Iterable[str]) -> alt.Scale:
    """The colour of each of these methods, by its label."""
    names = list(methods)
    others = [name for name in names if name not in COLOURS]
    spare = {name: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, name in enumerate(others)}
    return alt.Scale(
        domain=[label(name) for name in names],
        range=[COLOURS.get(name) or spare[name] for name in names],
    )


def panel_of(layers: Sequence[alt.Chart], title: str, *, width: int, height: int) -> alt.LayerChart:
    """One panel of a figure: layers above each other, the last on top."""
    return alt.LayerChart(layer=list(layers), title=title, width=width, height=height)


def in_a_row(panels: Sequence[alt.LayerChart]) -> alt.HConcatChart:
    """Panels side by side, with the same colours and each its own axes."""
    same_colours = alt.Resolve(scale=alt.ScaleResolveMap(color="shared"))
    return styled(alt.HConcatChart(hconcat=list(panels), resolve=same_colours))


def stacked(panels: Sequence[alt.LayerChart]) -> alt.VConcatChart:
    """Panels under each other, each with its own axes."""
    return styled(alt.VConcatChart(vconcat=list(panels)))


#: What ink, paper and lines are where the page is dark.
_IN_THE_DARK: Final[Mapping[str, str]] = MappingProxyType(
    {
        INK: "#eeece7",
        PAPER: "#141518",
        QUIET: "#7f828a",
        GRID: "#2a2c30",
        COLOURS["pbpo"]: "#6f9bff",
        COLOURS["knockout"]: "#9aa1ad",
    }
)


def in_the_dark(specification: str) -> str:
    """The same chart, given as JSON, for a dark page; files keep their paper."""
    for light, dark in _IN_THE_DARK.items():
        specification = specification.replace(f'"{light}"', f'"{dark}"')
    return specification


def styled(chart: Concatenated) -> Concatenated:
    """The chart with the type and ink that all figures share."""
    axis: dict[str, Any] = {
        "labelColor": INK,
        "titleColor": INK,
        "titleFontWeight": "normal",
        "domainColor": QUIET,
        "tickColor": QUIET,
        "gridColor": GRID,
    }
    result: Concatenated = (
        chart.configure(font=FONT, background=PAPER)
        .configure_view(stroke=None)
        .configure_axis(**axis)
        .configure_legend(
            orient="bottom",
            title=None,
            labelColor=INK,
            titleColor=INK,
            labelLimit=240,
            symbolOpacity=1,
        )
        .configure_title(color=INK, fontSize=13, fontWeight="bold", anchor="start")
    )
    return result
