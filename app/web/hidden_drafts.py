"""Drafts are nobody's to see but those who make them and those who try them in a pilot."""

from __future__ import annotations

from fastapi import Request

from app.services import modes, participation, pilots, studies
from app.services.errors import EntryLinkError, ServiceError
from app.services.studio import Studio

from . import entrances
from .security import session_cookie

#: The parameter of a link that lets people into a pilot.
_ENTRY = "entry"


def is_hidden(request: Request, slug: str, studio: Studio) -> bool:
    """Whether the study is a draft, and the request is a stranger's. Raises NotFoundError."""
    study = studies.find(studio, slug)
    mode = entrances.mode_of(request)
    if study.status != studies.DRAFT or mode == modes.PREVIEW:
        return False
    token = request.cookies.get(session_cookie(slug))
    if token is not None and _is_known(studio, token):
        return False
    if mode != modes.PILOT:
        return True
    try:
        with studio.database.read() as session:
            pilots.require_link(session, study, request.query_params.get(_ENTRY))
    except EntryLinkError:
        return True
    return False


def _is_known(studio: Studio, token: str) -> bool:
    try:
        participation.current(studio, token)
    except ServiceError:
        return False
    return True
