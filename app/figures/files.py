"""A chart as files: SVG and PNG, drawn by vl-convert without a browser."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final, Protocol

import altair as alt
import vl_convert

PNG_SCALE: Final = 2.0  # pixels per point: sharp on dense screens and in print

#: As vl-convert names Vega-Lite's versions, "6.1" for "v6.1.0".
_VEGA_LITE: Final = ".".join(alt.SCHEMA_VERSION.removeprefix("v").split(".")[:2])
#: Coordinates finer than a hundredth of a point are not seen, and make up half of a map's file.
_FINE_NUMBER: Final = re.compile(r"-?\d+\.\d{3,}")
#: What vl-convert numbers on and on from one drawing to the next.
_NUMBERED: Final = re.compile(r"\b(gradient_|clip)\d+")


class Drawable(Protocol):
    """Any Altair chart."""

    def to_dict(self) -> dict[str, Any]: ...


def svg(chart: Drawable) -> str:
    """The chart as SVG. The same chart gives the same text."""
    text = vl_convert.vegalite_to_svg(chart.to_dict(), vl_version=_VEGA_LITE)
    names: dict[str, str] = {}
    text = _NUMBERED.sub(lambda found: names.setdefault(found[0], f"{found[1]}{len(names)}"), text)
    return _FINE_NUMBER.sub(lambda found: f"{float(found[0]):.2f}", text)


def png(drawing: str) -> bytes:
    """A chart's SVG as PNG, sharp on dense screens."""
    return vl_convert.svg_to_png(drawing, scale=PNG_SCALE)


def save(chart: Drawable, folder: Path, name: str) -> tuple[Path, Path]:
    """Write folder/name.svg and folder/name.png, one picture, each file whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    text = svg(chart)
    image = png(text)
    paths = folder / f"{name}.svg", folder / f"{name}.png"
    for path, content in zip(paths, (text.encode(), image), strict=True):
        part = path.with_name(f".{path.name}.part")
        part.write_bytes(content)
        part.replace(path)
    return paths
