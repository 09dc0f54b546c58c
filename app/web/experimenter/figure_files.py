"""A finding as an answer: for the page as JSON, for a reader as PNG, SVG or the CSV behind it."""

from __future__ import annotations

import json
from typing import Final, Literal

from fastapi.responses import Response

from app.services.results.result import Result, as_csv
from app.services.runtime.errors import NotFoundError
from app.services.studies.repository import StudyInfo

Form = Literal["json", "png", "svg", "csv"]
Theme = Literal["light", "dark"]

_MEDIA_TYPES: Final = {
    "json": "application/json",
    "png": "image/png",
    "svg": "image/svg+xml",
    "csv": "text/csv; charset=utf-8",
}


def figure(
    name: str, found: Result, study: StudyInfo, form: Form, theme: Theme, file: str
) -> Response:
    """The finding in this form; `file` is what it is called where it is saved.

    Drawing takes up to some seconds: not for the event loop. Raises NotFoundError for a picture of
    nothing.
    """
    headers = {"Cache-Control": "no-store"}
    if form != "json":
        headers["Content-Disposition"] = f'attachment; filename="{file}.{form}"'
    return Response(_content(name, found, study, form, theme), 200, headers, _MEDIA_TYPES[form])


def _content(name: str, found: Result, study: StudyInfo, form: Form, theme: Theme) -> bytes | str:
    if form == "csv":
        return as_csv(found.rows)
    if form == "json":
        chart = _drawn(name, found, study, theme) if found.rows else "null"
        told = json.dumps({"says": found.says, "notes": found.notes, "rows": len(found.rows)})
        return f'{told[:-1]}, "chart": {chart}}}'
    if not found.rows:
        raise NotFoundError(f"there is nothing to draw yet: {found.says}")
    # Charts take more than a second to load, which no server needs that nobody asks for one.
    from app.figures import png, svg  # noqa: PLC0415
    from app.services.results.charts import draw  # noqa: PLC0415

    drawing = svg(draw(name, found, study))
    return drawing if form == "svg" else png(drawing)


def _drawn(name: str, found: Result, study: StudyInfo, theme: Theme) -> str:
    from app.figures import in_the_dark  # noqa: PLC0415
    from app.services.results.charts import draw  # noqa: PLC0415

    chart = draw(name, found, study).to_dict()
    # The page's own ground shows through; a file has its paper.
    chart["config"]["background"] = None
    text = json.dumps(chart)
    return in_the_dark(text) if theme == "dark" else text
