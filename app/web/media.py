"""Recordings, under addresses that say nothing, by ranges, for browsers to keep.

Where a store of the network has them, browsers are sent there by links that are good for minutes.
"""

from __future__ import annotations

import asyncio
import mimetypes
from concurrent.futures import Future
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, RedirectResponse, Response
from starlette.concurrency import run_in_threadpool

from app.services.recordings import Source
from app.services.stores.store import KEPT, Link
from app.services.studio import Studio

from .security import StudioDep

router = APIRouter(tags=["media"])


@router.api_route(
    "/media/{public_id}.mp4",
    methods=["GET", "HEAD"],
    response_class=FileResponse,
    include_in_schema=False,
)
async def recording(public_id: str, request: Request, studio: StudioDep) -> Response:
    """A recording's video; one that is not there yet is rendered first."""
    etag = f'"{public_id}"'
    if request.headers.get("if-none-match") == etag:
        await run_in_threadpool(studio.recordings.find, public_id)
        return Response(status_code=304, headers={"ETag": etag, "Cache-Control": KEPT})
    source, made = await run_in_threadpool(_begun, studio, public_id)
    # Shielded: one browser that goes away must not stop a video that others wait for.
    await asyncio.shield(asyncio.wrap_future(made))
    place = studio.recordings.hand_out(source, head=request.method == "HEAD")
    if isinstance(place, Link):
        kept = f"private, max-age={place.seconds}"
        return RedirectResponse(place.url, 307, headers={"Cache-Control": kept})
    # A study's own videos may be of another form than the address says.
    form = mimetypes.guess_type(place.name)[0] or "video/mp4"
    return _Video(place, media_type=form, headers={"Cache-Control": KEPT, "ETag": etag})


def _begun(studio: Studio, public_id: str) -> tuple[Source, Future[Any]]:
    source = studio.recordings.find(public_id)
    return source, studio.recordings.ensure(source)


class _Video(FileResponse):
    # Each piece is read by another thread, which is waited for: most videos are one piece.
    chunk_size = 1024 * 1024
