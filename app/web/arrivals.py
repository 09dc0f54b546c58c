"""What a request says of the person who comes: their platform's ids, or the token of their link."""

from __future__ import annotations

from fastapi import Request

from app.services import entry_links, holding, modes, recruitment, studies
from app.services.errors import IdsRefusedError
from app.services.fault_counts import Kind, Where
from app.services.holding import Holder
from app.services.studio import Studio
from app.study.identifiers import Given

from . import browser_cookies, entrances
from .security import session_cookie

#: The parameter of a link that lets one person in.
ENTRY = "entry"


def given(request: Request, slug: str, studio: Studio) -> Given:
    """What the link says that may be kept. Raises NotFoundError or IdsRefusedError."""
    if not request.query_params or entrances.mode_of(request) != modes.LIVE:
        # Who only tries the study is nobody's participant.
        return Given({})
    try:
        return recruitment.in_link(studio, slug, request.query_params.multi_items())
    except IdsRefusedError:
        studio.faults.note(Kind.UNREADABLE, Where(slug=slug))
        raise


def entry(request: Request) -> str | None:
    """The token of a personal link; None where the link is the same for everybody."""
    return request.query_params.get(ENTRY, "").strip() or None


def holder(request: Request, slug: str, studio: Studio) -> Holder:
    """Who comes, as against the session that the browser holds. Raises as `given` does."""
    token = request.cookies.get(session_cookie(slug))
    found = holding.holder(studio, slug, token, given(request, slug, studio).ids)
    link = entry(request)
    if found is not Holder.SAME or link is None or entrances.mode_of(request) != modes.LIVE:
        return found
    if _is_single_use(studio, slug):
        return Holder.SAME if browser_cookies.began_by(request, slug, link) else Holder.OTHER
    return found


def _is_single_use(studio: Studio, slug: str) -> bool:
    return entry_links.wanted(studies.find(studio, slug).plan)


def note_unfilled(studio: Studio, slug: str, given: Given) -> None:
    """Have those who run the study told that somebody began by a link that was not filled in."""
    if given.unfilled:
        studio.faults.note(Kind.UNFILLED, Where(slug=slug))
