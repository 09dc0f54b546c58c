"""What a request says of the person who comes: their platform's ids, or the token of their link."""

from __future__ import annotations

from fastapi import Request

from app.services import modes, recruitment
from app.services.errors import IdsRefusedError
from app.services.fault_counts import Kind, Where
from app.services.studio import Studio
from app.study.identifiers import Given

from . import entrances

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


def note_unfilled(studio: Studio, slug: str, given: Given) -> None:
    """Have those who run the study told that somebody began by a link that was not filled in."""
    if given.unfilled:
        studio.faults.note(Kind.UNFILLED, Where(slug=slug))
