"""Drafts are visible only to their experimenters and to holders of the pilot link."""

from __future__ import annotations

from fastapi import Request

from app.services.arrival import pilot_links
from app.services.context import AppContext
from app.services.runtime.errors import EntryLinkError, ServiceError
from app.services.sessions import advance
from app.services.studies import repository, session_modes
from app.web.http import session_paths
from app.web.http.security import session_cookie

#: The parameter of a pilot link.
_ENTRY = "entry"


def is_hidden(request: Request, slug: str, app: AppContext) -> bool:
    """Whether the study is a draft that this request may not see. Raises NotFoundError."""
    study = repository.find(app, slug)
    mode = session_paths.mode_of(request)
    if study.status != repository.DRAFT or mode == session_modes.PREVIEW:
        return False
    token = request.cookies.get(session_cookie(slug))
    if token is not None and _is_known(app, token):
        return False
    if mode != session_modes.PILOT:
        return True
    try:
        with app.database.read() as db:
            pilot_links.require_link(db, study, request.query_params.get(_ENTRY))
    except EntryLinkError:
        return True
    return False


def _is_known(app: AppContext, token: str) -> bool:
    try:
        advance.current(app, token)
    except ServiceError:
        return False
    return True
