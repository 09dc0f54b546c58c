"""Renders a report as PDF by Typst: tagged for screen readers (PDF/UA-1), with embedded fonts."""

from __future__ import annotations

import io
import json
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import typst
from PIL import Image

from app.figures import png
from app.figures.files import PNG_SCALE

from .document import Block, Figure, Report

#: Width of the text area of an A4 page.
_WIDEST_PT = 470
_PT_PER_PX = 0.75

_TEMPLATE = Path(__file__).with_name("report.typ")


def pdf(report: Report) -> bytes:
    """The report as PDF. The same report and fonts give the same bytes."""
    with tempfile.TemporaryDirectory(prefix="pbpo-report-") as folder:
        root = Path(folder)
        blocks = [_as_data(block, root, number) for number, block in enumerate(report.blocks)]
        said = {"title": report.title, "subtitle": report.subtitle, "blocks": blocks}
        main = root / "main.typ"
        main.write_bytes(_TEMPLATE.read_bytes())
        # The content is passed as data, so that no text is interpreted as Typst markup.
        made = typst.compile(
            str(main),
            root=folder,
            sys_inputs={"report": json.dumps(said, ensure_ascii=False)},
            pdf_standards=["ua-1"],
        )
    assert isinstance(made, bytes)
    return made


def _as_data(block: Block, root: Path, number: int) -> dict[str, Any]:
    data = {"kind": type(block).__name__.lower(), **asdict(block)}
    if isinstance(block, Figure):
        # As a bitmap, because the figure's text uses fonts that Typst does not have.
        path = root / f"figure-{number}.png"
        picture = png(block.drawing)
        path.write_bytes(picture)
        data["drawing"] = path.name
        data["width_pt"] = min(_WIDEST_PT, _PT_PER_PX * _width_px(picture) / PNG_SCALE)
    return data


def _width_px(picture: bytes) -> int:
    with Image.open(io.BytesIO(picture)) as opened:
        return opened.width
