"""Recordings, under addresses that say nothing, by ranges, for browsers to keep.

Where a store of the network has them, browsers are sent there by links that are good for minutes;
where the proxy in front may send them, it is told which.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, RedirectResponse, Response
from starlette.concurrency import run_in_threadpool

from app.services.recordings import Source
from app.services.stores.store import KEPT, Errand, Link, form_of
from app.services.studio import Studio

from . import video_file
from .security import StudioDep

router = APIRouter(tags=["media"])

#: What a proxy understands and browsers never see: the address of a file that it has itself.
TO_PROXY = "X-Accel-Redirect"


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
    headers = {"Cache-Control": KEPT, "ETag": etag}
    if isinstance(place, Errand):
        # No body: the proxy puts the file in its place, or the part that was asked for.
        sent_by_proxy = {TO_PROXY: place.address, **headers}
        return Response(media_type=form_of(place.address), headers=sent_by_proxy)
    return await run_in_threadpool(video_file.answer, place, request, headers)


def _begun(studio: Studio, public_id: str) -> tuple[Source, Future[Any]]:
    source = studio.recordings.find(public_id)
    return source, studio.recordings.ensure(source)
