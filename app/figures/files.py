"""A chart as files: SVG and PNG, drawn by vl-convert without a browser."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Final, Protocol

PNG_SCALE: Final = 2  # pixels per point: sharp on dense screens and in print

#: Coordinates finer than a hundredth of a point are not seen, and make up half of a map's file.
_FINE_NUMBER: Final = re.compile(r"-?\d+\.\d{3,}")


class Drawable(Protocol):
    """Any Altair chart."""

    def save(self, fp: io.IOBase, format: str, **options: object) -> None: ...  # noqa: A002


def svg(chart: Drawable) -> bytes:
    """The chart as SVG."""
    text = io.StringIO()
    chart.save(text, format="svg")
    coarse = _FINE_NUMBER.sub(lambda found: f"{float(found[0]):.2f}", text.getvalue())
    return coarse.encode()


def png(chart: Drawable) -> bytes:
    """The chart as PNG."""
    image = io.BytesIO()
    chart.save(image, format="png", scale_factor=PNG_SCALE)
    return image.getvalue()


def save(chart: Drawable, folder: Path, name: str) -> tuple[Path, Path]:
    """Write folder/name.svg and folder/name.png, each whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = folder / f"{name}.svg", folder / f"{name}.png"
    for path, content in zip(paths, (svg(chart), png(chart)), strict=True):
        part = path.with_name(f".{path.name}.part")
        part.write_bytes(content)
        part.replace(path)
    return paths
