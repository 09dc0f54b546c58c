"""Recordings, under addresses that say nothing, by ranges, for browsers to keep.

Where a store of the network has them, browsers are sent there by links that are good for minutes;
where the proxy in front may send them, it is told which.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, RedirectResponse, Response
from starlette.concurrency import run_in_threadpool

from app.services.context import AppContext
from app.services.recordings.recordings import Source
from app.services.recordings.stores.interface import KEPT, InternalRedirect, SignedUrl, form_of
from app.services.runtime.errors import StoreAwayError
from app.web.http import video_file
from app.web.http.security import AppDep

router = APIRouter(tags=["media"])

#: What a proxy understands and browsers never see: the address of a file that it has itself.
TO_PROXY = "X-Accel-Redirect"

#: How long a browser waits for a video that has to be made, in seconds: less than it, or a proxy in
#: between, would wait for any answer. The video goes on being made, for when it is asked for again.
MADE_WITHIN_S = 50.0


@router.api_route(
    "/media/{public_id}.mp4",
    methods=["GET", "HEAD"],
    response_class=FileResponse,
    include_in_schema=False,
)
async def recording(public_id: str, request: Request, app: AppDep) -> Response:
    """A recording's video; one that is not there yet is rendered first."""
    # One hand-over to a thread, if the video is there: on a busy server each has to be waited for.
    begun = await run_in_threadpool(_begun, app, public_id, request)
    if isinstance(begun, _Coming):
        await _until_made(begun.made)
        begun = await run_in_threadpool(_answer, app, public_id, begun.source, request)
    return begun


@dataclass(frozen=True)
class _Coming:
    """A video that is being made."""

    source: Source
    made: Future[Any]


async def _until_made(made: Future[Any]) -> None:
    """Raises what went wrong with the video, and StoreAwayError where it takes too long."""
    try:
        # Shielded: one browser that goes away must not stop a video that others wait for.
        await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(made)), MADE_WITHIN_S)
    except TimeoutError:
        if made.done():
            raise
        # No worker is there, say: an answer is counted, and told to those who run the study.
        raise StoreAwayError(
            f"expected the video to be made within {MADE_WITHIN_S:g} s; try again"
        ) from None


def _begun(app: AppContext, public_id: str, request: Request) -> Response | _Coming:
    """The answer if the video is there, or the browser has it; else it is begun."""
    source = _source(app, public_id)
    if request.headers.get("if-none-match") == _etag(public_id):
        headers = {"ETag": _etag(public_id), "Cache-Control": KEPT}
        return Response(status_code=304, headers=headers)
    made = app.recordings.ensure(source)
    is_there = made.done() and made.exception() is None
    return _answer(app, public_id, source, request) if is_there else _Coming(source, made)


def _source(app: AppContext, name: str) -> Source:
    """Of a name that a session knows, or of a public id, which experimenters' pages show."""
    shown = app.addresses.opened(name)
    if shown is None:
        return app.recordings.find(name)
    return app.recordings.of_session(shown)


def _answer(app: AppContext, public_id: str, source: Source, request: Request) -> Response:
    """The video that is there."""
    place = app.recordings.serve(source, head=request.method == "HEAD")
    if isinstance(place, SignedUrl):
        kept = f"private, max-age={place.seconds}"
        return RedirectResponse(place.url, 307, headers={"Cache-Control": kept})
    headers = {"Cache-Control": KEPT, "ETag": _etag(public_id)}
    if isinstance(place, InternalRedirect):
        # No body: the proxy puts the file in its place, or the part that was asked for.
        sent_by_proxy = {TO_PROXY: place.address, **headers}
        return Response(media_type=form_of(place.address), headers=sent_by_proxy)
    return video_file.answer(place, request, headers)


def _etag(public_id: str) -> str:
    return f'"{public_id}"'
