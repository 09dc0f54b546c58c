"""An experimenter's exports, streamed."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse

from app.services import access
from app.services.access import Right
from app.services.errors import NotFoundError
from app.services.export import TABLES, ZIPPED, Request, csv_stream, zip_stream
from app.services.results import MODES

from .problems import refusals
from .security import ExperimenterDep, StudioDep

router = APIRouter(prefix="/api/v1/studies/{slug}", tags=["export"])

Mode = Literal["live", "preview", "simulated", "all"]
ModeQuery = Annotated[
    list[Mode] | None, Query(alias="mode", description="Which sessions count. Default: live.")
]


@router.get("/export.zip", response_class=StreamingResponse, responses=refusals(401, 403, 404, 422))
def export_zip(
    slug: str, studio: StudioDep, caller: ExperimenterDep, mode: ModeQuery = None
) -> StreamingResponse:
    """Every table but the identities, in one zip."""
    request = Request(access.study_for(studio, caller, slug, Right.DATA), modes_of(mode))
    return StreamingResponse(
        zip_stream(studio, ZIPPED, request),
        media_type="application/zip",
        headers=_as_file(f"{slug}.zip"),
    )


@router.get(
    "/export/{table}.csv", response_class=StreamingResponse, responses=refusals(401, 403, 404, 422)
)
def export_table(
    slug: str, table: str, studio: StudioDep, caller: ExperimenterDep, mode: ModeQuery = None
) -> StreamingResponse:
    """One table as CSV."""
    request = Request(access.study_for(studio, caller, slug, Right.DATA), modes_of(mode))
    if table not in TABLES:
        raise NotFoundError(f"expected one of {', '.join(TABLES)}, got {table!r}")
    return StreamingResponse(
        csv_stream(studio, TABLES[table], request),
        media_type="text/csv; charset=utf-8",
        headers=_as_file(f"{slug}-{table}.csv"),
    )


def modes_of(chosen: list[Mode] | None) -> tuple[str, ...]:
    """The modes that count: live, unless others are asked for."""
    if not chosen:
        return ("live",)
    return MODES if "all" in chosen else tuple(dict.fromkeys(chosen))


def _as_file(name: str) -> dict[str, str]:
    return {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
