"""Renders a report as PDF by Typst: tagged for screen readers (PDF/UA-1), with embedded fonts."""

from __future__ import annotations

import io
import json
import re
import sys
import tempfile
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import typst
from PIL import Image

from app.figures import png
from app.figures.files import PNG_SCALE
from app.services.runtime.errors import PdfError

from .document import Block, Figure, Report

#: Width of the text area of an A4 page.
_WIDEST_PT = 470
_PT_PER_PX = 0.75

#: What Typst says of text for which no font is installed.
_MISSING = re.compile(r'the text `?"(.+?)"`? could not be displayed', re.DOTALL)
_MOST_TRIES = 5
#: Letters up to here are in the font that Typst brings along.
_LAST_LATIN = 0x024F
#: A letter as Typst's messages spell it, where it cannot be shown.
_SPELT = re.compile(r"\\u\{([0-9a-f]+)\}")
_TEMPLATE = Path(__file__).with_name("report.typ")


def pdf(report: Report) -> bytes:
    """The report as PDF. The same report and fonts give the same bytes.

    A letter that no installed font has is replaced by its code in brackets, such as [U+1FAD7].
    Raises PdfError if no PDF can be made.
    """
    tries = 0
    while True:
        try:
            return _compiled(report)
        except typst.TypstError as error:
            missing = _MISSING.search(str(error))
            text = _SPELT.sub(lambda of: chr(int(of[1], 16)), missing[1]) if missing else ""
            letters = {one for one in text if not one.isascii()}
            if letters and tries >= _MOST_TRIES:
                # Each try takes as long as a report: a whole script is missing.
                letters |= set(map(chr, range(_LAST_LATIN, sys.maxunicode)))
            if not letters:
                message = f"expected a report that can be a PDF, got {str(error).strip()}"
                raise PdfError(f"{message}; its HTML can be had") from error
            report = _spelt_out(report, letters)
            tries += 1


def _spelt_out(value: Any, letters: set[str]) -> Any:
    """The same, with each of these letters as its code."""
    if isinstance(value, str):
        return "".join(f"[U+{ord(one):04X}]" if one in letters else one for one in value)
    if isinstance(value, tuple | list):
        return type(value)(_spelt_out(one, letters) for one in value)
    if isinstance(value, Figure):
        # Its drawing is a picture, made with the fonts of the figures.
        return replace(
            value,
            caption=_spelt_out(value.caption, letters),
            says=_spelt_out(value.says, letters),
        )
    if is_dataclass(value) and not isinstance(value, type):
        said = {one.name: _spelt_out(getattr(value, one.name), letters) for one in fields(value)}
        return replace(value, **said)
    return value


def _compiled(report: Report) -> bytes:
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
