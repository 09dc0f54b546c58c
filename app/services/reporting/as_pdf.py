"""A report as PDF, set by Typst: tagged for screen readers (PDF/UA-1), with fonts of its own."""

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

#: What an A4 page has between its margins.
_WIDEST_PT = 470
_PT_PER_PX = 0.75

_TEMPLATE = Path(__file__).with_name("report.typ")


def pdf(report: Report) -> bytes:
    """The same report gives the same bytes, where the same fonts are installed."""
    with tempfile.TemporaryDirectory(prefix="pbpo-report-") as folder:
        root = Path(folder)
        blocks = [_told(block, root, number) for number, block in enumerate(report.blocks)]
        said = {"title": report.title, "subtitle": report.subtitle, "blocks": blocks}
        main = root / "main.typ"
        main.write_bytes(_TEMPLATE.read_bytes())
        # What it says comes in as data, so that no text is taken for a command.
        made = typst.compile(
            str(main),
            root=folder,
            sys_inputs={"report": json.dumps(said, ensure_ascii=False)},
            pdf_standards=["ua-1"],
        )
    assert isinstance(made, bytes)
    return made


def _told(block: Block, root: Path, number: int) -> dict[str, Any]:
    told = {"kind": type(block).__name__.lower(), **asdict(block)}
    if isinstance(block, Figure):
        # As a picture: its words are drawn with fonts that Typst does not bring along.
        path = root / f"figure-{number}.png"
        picture = png(block.drawing)
        path.write_bytes(picture)
        told["drawing"] = path.name
        told["width_pt"] = min(_WIDEST_PT, _PT_PER_PX * _width_px(picture) / PNG_SCALE)
    return told


def _width_px(picture: bytes) -> int:
    with Image.open(io.BytesIO(picture)) as opened:
        return opened.width
