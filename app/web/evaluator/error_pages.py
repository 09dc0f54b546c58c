"""Error pages of evaluators: each says that the server failed, and has the return link.

Pages of all modes of a session (`entrances`) are such routes.
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
from app.study.stages import ProtocolError
from app.web.http import session_paths
from app.web.http.security import app_context_of, session_cookie
from app.web.http.translations import translatable

from .session_pages import render

log = logging.getLogger(__name__)

#: Intended refusals have pages of their own.
_ON_PURPOSE = (ServiceError, ProtocolError, HTTPException, RequestValidationError)

Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class EvaluatorRoute(APIRoute):
    """A route of `/s/{slug}` that answers failures with an error page."""

    def get_route_handler(self) -> Handler:
        """The handler of the route, with failures turned into pages."""
        handle = super().get_route_handler()

        async def handle_kindly(request: Request) -> Response:
            slug = request.path_params["slug"]
            mode = session_paths.mode_of(request)
            try:
                await session_paths.require_admitted(request, mode, slug)
                await session_paths.read_mode_cookies(request, mode, slug)
                response = await handle(request)
                session_paths.write_mode_cookies(response, mode, slug)
                return response
            except _ON_PURPOSE:
                raise
            except Exception as error:
                # The result of the concurrent request is shown when the page is loaded again.
                if is_conflict(error):
                    raise
                log.exception("a page of the study %r failed", slug)
                return await run_in_threadpool(_failed, request, slug)

        return handle_kindly


def _failed(request: Request, slug: str) -> Response:
    token = request.cookies.get(session_cookie(slug))
    way_back = None
    if session_paths.mode_of(request) == session_modes.LIVE:
        way_back = failure_return.after_a_failure(app_context_of(request), slug, token)
    return render(
        request,
        slug,
        "participant/failed.html",
        translatable("Something failed"),
        status=500,
        way_back=way_back,
    )
