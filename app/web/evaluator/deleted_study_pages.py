"""Responses for a deleted study: 410 with an explanation and the participant's return link.

Deleted studies are looked up only after a study or a session was not found.
"""

from __future__ import annotations

import re

from fastapi import FastAPI, Request
from fastapi.responses import Response
from starlette.concurrency import run_in_threadpool

from app.services.runtime.errors import NotFoundError, SignInRequiredError, StudyDeletedError
from app.services.studies import deleted_studies, session_modes
from app.services.studies.deleted_studies import Deleted
from app.web.http import problems, session_paths
from app.web.http.security import app_context_of, bearer
from app.web.http.translations import translatable

from .session_pages import render

#: Participants' addresses that name a study.
_PAGE = re.compile(r"/s/([^/]+)(/.*)?")
_CALL = re.compile(r"/api/v1/studies/([^/]+)/(sessions|deletions)")
_SESSION = re.compile(r"/api/v1/session(/.*)?")


def install(app: FastAPI) -> None:
    """Register these handlers. Call it after `problems.install`, whose handlers it replaces."""
    for error in (NotFoundError, SignInRequiredError):
        app.add_exception_handler(error, _not_there)


async def _not_there(request: Request, error: Exception) -> Response:
    deleted = await run_in_threadpool(_deleted, request)
    if deleted is None:
        return await problems.domain_error(request, error)
    message = "the study was deleted, with all the answers that were given in it"
    gone = StudyDeletedError(message, way_back=deleted.way_back)
    if _PAGE.fullmatch(request.url.path) is None:
        return await problems.domain_error(request, gone)
    return render(
        request,
        deleted.slug,
        "participant/study_deleted.html",
        translatable("This study has ended"),
        status=problems.kind_of(gone).status,
        way_back=deleted.way_back,
    )


def _deleted(request: Request) -> Deleted | None:
    path = request.url.path
    if _SESSION.fullmatch(path):
        said = request.headers.get("PBPO-Study")
        mode, slug = session_paths.of_header(said) if said else (session_modes.LIVE, None)
        token = bearer(request.headers.get("authorization"))
        if slug is not None and mode == session_modes.LIVE and token is None:
            token = request.cookies.get(session_paths.cookie_of(mode, slug))
        return deleted_studies.find(app_context_of(request), slug, token)
    named = _PAGE.fullmatch(path) or _CALL.fullmatch(path)
    if named is None:
        return None
    token = request.cookies.get(session_paths.cookie_of(session_modes.LIVE, named[1]))
    return deleted_studies.find(app_context_of(request), named[1], token)
