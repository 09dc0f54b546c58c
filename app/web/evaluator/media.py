"""Serves recordings under opaque addresses, by ranges, cacheable by browsers.

With an S3 store browsers are redirected to signed links; with a proxy that sends videos itself, the
response names the file in `X-Accel-Redirect`.
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

#: Header for the proxy, which never reaches browsers: the proxy's own address of the file.
TO_PROXY = "X-Accel-Redirect"

#: Longest wait for a video that has to be rendered, in seconds: below the timeouts of browsers and
#: proxies. Rendering continues, so that a later request finds the video.
MADE_WITHIN_S = 50.0


@router.api_route(
    "/media/{public_id}.mp4",
    methods=["GET", "HEAD"],
    response_class=FileResponse,
    include_in_schema=False,
)
async def recording(public_id: str, request: Request, app: AppDep) -> Response:
    """A recording's video; it is rendered first if it does not exist yet."""
    from_memory = _from_memory(app, public_id, request)
    if from_memory is not None:
        return from_memory
    # One call in a thread if the video exists: on a busy server each waits for its thread.
    begun = await run_in_threadpool(_begun, app, public_id, request)
    if isinstance(begun, _Coming):
        await _until_made(begun.made)
        begun = await run_in_threadpool(_answer, app, public_id, begun.source, request)
    return begun


def _from_memory(app: AppContext, name: str, request: Request) -> Response | None:
    """The response if everything it needs is in this process's and the kernel's caches, else None.

    Most videos are. The event loop answers these itself: handing them to threads takes longer, and
    threads compete with responses for the interpreter.
    """
    shown = app.addresses.opened(name)
    source = None if shown is None else app.recordings.of_session_cached(shown)
    file = None if source is None else app.recordings.local_file(source)
    if file is None:
        return None
    return _not_modified(name, request) or video_file.answer_from_memory(file, request, _kept(name))


@dataclass(frozen=True)
class _Coming:
    """A video that is being rendered."""

    source: Source
    made: Future[Any]


async def _until_made(made: Future[Any]) -> None:
    """Raises what went wrong with the video, and StoreAwayError where it takes too long."""
    try:
        # Shielded: a browser that disconnects must not cancel a video that others wait for.
        await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(made)), MADE_WITHIN_S)
    except TimeoutError:
        if made.done():
            raise
        # There may be no worker: the failure is counted and shown to experimenters.
        raise StoreAwayError(
            f"expected the video to be made within {MADE_WITHIN_S:g} s; try again"
        ) from None


def _begun(app: AppContext, public_id: str, request: Request) -> Response | _Coming:
    """The response if the video exists or the browser has it; else its rendering is started."""
    source = _source(app, public_id)
    if not_modified := _not_modified(public_id, request):
        return not_modified
    made = app.recordings.ensure(source)
    is_there = made.done() and made.exception() is None
    return _answer(app, public_id, source, request) if is_there else _Coming(source, made)


def _source(app: AppContext, name: str) -> Source:
    """The source of a name issued to a session, or of a public id as on experimenters' pages."""
    shown = app.addresses.opened(name)
    if shown is None:
        return app.recordings.find(name)
    return app.recordings.of_session(shown)


def _answer(app: AppContext, public_id: str, source: Source, request: Request) -> Response:
    """The response with a video that exists."""
    place = app.recordings.serve(source, head=request.method == "HEAD")
    if isinstance(place, SignedUrl):
        kept = f"private, max-age={place.seconds}"
        return RedirectResponse(place.url, 307, headers={"Cache-Control": kept})
    headers = _kept(public_id)
    if isinstance(place, InternalRedirect):
        # No body: the proxy replaces it with the file or the requested range.
        sent_by_proxy = {TO_PROXY: place.address, **headers}
        return Response(media_type=form_of(place.address), headers=sent_by_proxy)
    return video_file.answer(place, request, headers)


def _not_modified(public_id: str, request: Request) -> Response | None:
    """The response if the browser has the video already, otherwise None."""
    if request.headers.get("if-none-match") != _etag(public_id):
        return None
    return Response(status_code=304, headers=_kept(public_id))


def _kept(public_id: str) -> dict[str, str]:
    """The headers by which browsers keep a video."""
    return {"Cache-Control": KEPT, "ETag": _etag(public_id)}


def _etag(public_id: str) -> str:
    return f'"{public_id}"'
