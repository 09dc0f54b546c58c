"""What a request says of the person who comes: their platform's ids, or the token of their link."""

from __future__ import annotations

from fastapi import Request

from app.services import entry_links, holding, modes, recruitment, studies
from app.services.errors import IdsRefusedError, SignedLinkError
from app.services.fault_counts import Kind, Where
from app.services.holding import Holder
from app.services.platform_keys import READING_S
from app.services.studio import Studio
from app.study.identifiers import Given

from . import browser_cookies, entrances
from .security import session_cookie

#: The parameter of a link that lets one person in.
ENTRY = "entry"
#: By how much the platform's clock and ours may differ, in seconds.
_CLOCKS_APART_S = 60.0


def given(request: Request, slug: str, studio: Studio) -> Given:
    """What the link says that may be kept. Raises NotFoundError or IdsRefusedError."""
    if not request.query_params or entrances.mode_of(request) != modes.LIVE:
        # Who only tries the study is nobody's participant.
        return Given({})
    came = request.query_params.multi_items()
    if studies.find(studio, slug).plan.recruitment.signed_links:
        came = list(_signed(request, slug, studio, came).items())
    try:
        return recruitment.in_link(studio, slug, came)
    except IdsRefusedError:
        studio.faults.note(Kind.UNREADABLE, Where(slug=slug))
        raise


def _signed(
    request: Request, slug: str, studio: Studio, came: list[tuple[str, str]]
) -> dict[str, str]:
    """The parameters as the platform signed them. Raises SignedLinkError."""
    # The host that a request names proves nothing: it may be another tool's, as the token may be.
    address = f"{studio.settings.public_url}/s/{slug}"
    leeway_s = READING_S if request.method == "POST" else _CLOCKS_APART_S
    return studio.platform_keys.signed(came, address, leeway_s)


def require_signed(request: Request, slug: str, studio: Studio) -> bool:
    """Whether the link was signed, where its study wants that. Raises SignedLinkError."""
    wanted = studies.find(studio, slug).plan.recruitment.signed_links
    if not wanted or entrances.mode_of(request) != modes.LIVE:
        return False
    if not given(request, slug, studio).ids:
        raise SignedLinkError("expected a link that the platform signed, got one without a token")
    return True


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
