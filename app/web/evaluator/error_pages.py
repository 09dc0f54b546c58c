"""When something of ours fails, an evaluator gets a page that says so, and the way back.

The pages of each mode of a session (`entrances`) are these routes, too.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Coroutine
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from app.services.runtime.errors import ServiceError
from app.services.sessions import failure_return
from app.services.studies import session_modes
from app.storage.integrity_errors import is_conflict
from app.study.protocol import ProtocolError
from app.web.http import session_paths
from app.web.http.security import session_cookie, studio_of
from app.web.http.translations import translatable

from .session_pages import render

log = logging.getLogger(__name__)

#: What is refused on purpose has a page of its own.
_ON_PURPOSE = (ServiceError, ProtocolError, HTTPException, RequestValidationError)

Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class EvaluatorRoute(APIRoute):
    """A route of `/s/{slug}` whose failures end in a page."""

    def get_route_handler(self) -> Handler:
        handle = super().get_route_handler()

        async def handle_kindly(request: Request) -> Response:
            slug = request.path_params["slug"]
            mode = session_paths.mode_of(request)
            await session_paths.require_admitted(request, mode, slug)
            session_paths.take_in(request, mode, slug)
            try:
                response = await handle(request)
                session_paths.send_out(response, mode, slug)
                return response
            except _ON_PURPOSE:
                raise
            except Exception as error:
                # What somebody else did at the same moment is there when they look again.
                if is_conflict(error):
                    raise
                log.exception("a page of the study %r failed", slug)
                return await run_in_threadpool(_failed, request, slug)

        return handle_kindly


def _failed(request: Request, slug: str) -> Response:
    token = request.cookies.get(session_cookie(slug))
    way_back = None
    if session_paths.mode_of(request) == session_modes.LIVE:
        way_back = failure_return.after_a_failure(studio_of(request), slug, token)
    return render(
        request,
        slug,
        "participant/failed.html",
        translatable("Something failed"),
        status=500,
        way_back=way_back,
    )
