"""The parameters of an entry link: a person's ids at a platform, or a personal link's token."""

from __future__ import annotations

from fastapi import Request

from app.services.arrival import entry_links, session_holder
from app.services.arrival.session_holder import Holder
from app.services.context import AppContext
from app.services.failure_counter import FailureContext, Kind
from app.services.platform_keys import READING_S
from app.services.runtime.errors import IdsRefusedError, SignedLinkError
from app.services.sessions import completion
from app.services.studies import repository, session_modes
from app.study.identifiers import Given
from app.web.http import session_paths
from app.web.http.security import session_cookie

from . import session_cookies

#: The parameter of a personal link, which admits one person.
ENTRY = "entry"
#: By how much the platform's clock and ours may differ, in seconds.
_CLOCKS_APART_S = 60.0


def given(request: Request, slug: str, app: AppContext) -> Given:
    """The parameters of the link that may be stored. Raises NotFoundError or IdsRefusedError."""
    if not request.query_params or session_paths.mode_of(request) != session_modes.LIVE:
        # A preview or pilot has no participant.
        return Given({})
    came = request.query_params.multi_items()
    if repository.find(app, slug).plan.recruitment.signed_links:
        came = list(_signed(request, slug, app, came).items())
    try:
        return completion.in_link(app, slug, came)
    except IdsRefusedError:
        app.failures.buffer(Kind.UNREADABLE, FailureContext(slug=slug))
        raise


def _signed(
    request: Request, slug: str, app: AppContext, came: list[tuple[str, str]]
) -> dict[str, str]:
    """The parameters as the platform signed them. Raises SignedLinkError."""
    # The Host header proves nothing: it may be another tool's, as the token may be.
    address = f"{app.settings.public_base}/s/{slug}"
    leeway_s = READING_S if request.method == "POST" else _CLOCKS_APART_S
    return app.platform_keys.signed(came, address, leeway_s)


def require_signed(request: Request, slug: str, app: AppContext) -> bool:
    """Whether the link was signed, if its study requires that. Raises SignedLinkError."""
    wanted = repository.find(app, slug).plan.recruitment.signed_links
    if not wanted or session_paths.mode_of(request) != session_modes.LIVE:
        return False
    if not given(request, slug, app).ids:
        raise SignedLinkError("expected a link that the platform signed, got one without a token")
    return True


def entry(request: Request) -> str | None:
    """The token of a personal link; None where the link is the same for everybody."""
    return request.query_params.get(ENTRY, "").strip() or None


def holder(request: Request, slug: str, app: AppContext) -> Holder:
    """The person of the link, compared with the browser's session. Raises as `given` does."""
    token = request.cookies.get(session_cookie(slug))
    found = session_holder.holder(app, slug, token, given(request, slug, app).ids)
    link = entry(request)
    if (
        found is not Holder.SAME
        or link is None
        or session_paths.mode_of(request) != session_modes.LIVE
    ):
        return found
    if _is_single_use(app, slug):
        return Holder.SAME if session_cookies.began_by(request, slug, link) else Holder.OTHER
    return found


def _is_single_use(app: AppContext, slug: str) -> bool:
    return entry_links.required(repository.find(app, slug).plan)


def note_unfilled(app: AppContext, slug: str, given: Given) -> None:
    """Count for the study's overview a session begun by a link with unfilled placeholders."""
    if given.unfilled:
        app.failures.buffer(Kind.UNFILLED, FailureContext(slug=slug))
