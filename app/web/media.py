"""Recordings, under addresses that say nothing, by ranges, for browsers to keep."""

from __future__ import annotations

import asyncio
import mimetypes

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, Response
from starlette.concurrency import run_in_threadpool

from .security import StudioDep

router = APIRouter(tags=["media"])

#: A recording never changes under its address, and is nobody else's to see.
_CACHE = "private, max-age=604800, immutable"


@router.api_route(
    "/media/{public_id}.mp4",
    methods=["GET", "HEAD"],
    response_class=FileResponse,
    include_in_schema=False,
)
async def recording(public_id: str, request: Request, studio: StudioDep) -> Response:
    """A recording's video; one that is not there yet is rendered first."""
    source = await run_in_threadpool(studio.recordings.find, public_id)
    etag = f'"{public_id}"'
    if request.headers.get("if-none-match") == etag:
        return Response(status_code=304, headers={"ETag": etag, "Cache-Control": _CACHE})
    # Shielded: one browser that goes away must not stop a video that others wait for.
    path = await asyncio.shield(asyncio.wrap_future(studio.recordings.ensure(source)))
    # A study's own videos may be of another form than the address says.
    form = mimetypes.guess_type(path.name)[0] or "video/mp4"
    return FileResponse(path, media_type=form, headers={"Cache-Control": _CACHE, "ETag": etag})
