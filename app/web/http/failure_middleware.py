"""Counts failed requests of participants, so that experimenters learn of them."""

from __future__ import annotations

import re
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.services.context import AppContext
from app.services.failure_counter import FailureContext, Kind

from . import session_paths
from .security import bearer

#: The header with which a page names the study of its call.
_STUDY_HEADER = "PBPO-Study"
_SERVER_FAULT = 500
_UNAVAILABLE = 503
_TOO_MANY = 429
_BEGINNING = re.compile(r"/api/v1/studies/[^/]+/sessions")


class FailureMiddleware:
    """Counts responses with a failure status to participants' pages, calls and videos."""

    def __init__(self, asgi_app: ASGIApp) -> None:
        self._app = asgi_app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        status = _SERVER_FAULT

        async def send_and_look(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, send_and_look)
        except Exception:
            await _count(scope, _SERVER_FAULT)
            raise
        await _count(scope, status)


async def _count(scope: Scope, status: int) -> None:
    if scope["type"] != "http" or status < _TOO_MANY:
        return
    kind = _kind(scope["path"], status)
    where = _where(scope) if kind is not None else None
    if kind is not None and where is not None:
        app: AppContext = scope["app"].state.app
        await run_in_threadpool(app.failures.count, kind, where)


def _kind(path: str, status: int) -> Kind | None:
    """The kind of failure, if the request was a participant's; else None."""
    is_page = path.startswith(("/s/", "/pilot/s/"))
    is_call = path.startswith("/api/v1/session") or _BEGINNING.fullmatch(path) is not None
    is_video = path.startswith("/media/")
    if status == _TOO_MANY:
        return Kind.CROWDED if is_page or is_call else None
    if status < _SERVER_FAULT or not (is_page or is_call or is_video):
        return None
    if is_video:
        return Kind.VIDEO
    if status == _UNAVAILABLE:
        return Kind.DATABASE
    return Kind.PAGE if is_page else Kind.CALL


def _where(scope: Scope) -> FailureContext | None:
    named: dict[str, Any] = scope.get("path_params", {})
    headers = Headers(scope=scope)
    app: AppContext = scope["app"].state.app
    if shown := app.addresses.opened(named.get("public_id", "")):
        return FailureContext(session_id=shown.session_id)
    _, slug = session_paths.of_header(headers.get(_STUDY_HEADER, ""))
    return FailureContext.of(
        named.get("slug") or slug or None,
        bearer(headers.get("authorization")),
        named.get("public_id"),
    )
