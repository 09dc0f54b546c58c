"""A result's figure as a response: JSON for the page, or PNG, SVG or CSV files."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any, Final, Literal

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
    name: str,
    found: Result,
    study: StudyInfo,
    form: Form,
    theme: Theme,
    file: str,
    *,
    of_people: bool = False,
) -> Response:
    """The figure in this format; `file` is the name under which it is saved.

    of_people: whether it is one of people judged together.
    Rendering takes up to some seconds: call it in a thread. Raises NotFoundError if the figure
    has no data.
    """
    headers = {"Cache-Control": "no-store"}
    if form != "json":
        headers["Content-Disposition"] = f'attachment; filename="{file}.{form}"'
    content = _content(name, found, study, form, theme, of_people)
    return Response(content, 200, headers, _MEDIA_TYPES[form])


def _content(
    name: str, found: Result, study: StudyInfo, form: Form, theme: Theme, of_people: bool
) -> bytes | str:
    if form == "csv":
        return as_csv(found.rows)
    if form == "json":
        chart = _on_a_page(_chart(name, found, study, of_people), theme) if found.rows else "null"
        told = json.dumps(
            {
                "says": found.says,
                "notes": found.notes,
                "summaries": [asdict(summary) for summary in found.summaries],
                "rows": len(found.rows),
            }
        )
        return f'{told[:-1]}, "chart": {chart}}}'
    if not found.rows:
        raise NotFoundError(f"there is nothing to draw yet: {found.says}")
    # Imported here: loading the chart libraries takes more than a second.
    from app.figures import png, svg  # noqa: PLC0415

    drawing = svg(_chart(name, found, study, of_people))
    return drawing if form == "svg" else png(drawing)


def _chart(name: str, found: Result, study: StudyInfo, of_people: bool) -> Any:
    if of_people:
        from app.services.results.people_charts import draw_people  # noqa: PLC0415

        return draw_people(name, found, study)
    from app.services.results.charts import draw  # noqa: PLC0415

    return draw(name, found, study)


def _on_a_page(chart: Any, theme: Theme) -> str:
    from app.figures import in_the_dark  # noqa: PLC0415

    specification = chart.to_dict()
    # On a page the background is transparent; a file has its own.
    specification["config"]["background"] = None
    text = json.dumps(specification)
    return in_the_dark(text) if theme == "dark" else text
