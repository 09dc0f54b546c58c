"""Tokens of previews, which name the sign-in or API token with which the preview was started.

A program that sends a preview's token as a bearer token is answered as long as that credential is
in force and its account may change the study. In a cookie the token counts at the addresses of
previews only, where every request needs the sign-in.

Tokens of other sessions are remembered by their hashes, because a session never changes its mode:
only the first call with each of them is looked up in the database.
"""

from __future__ import annotations

from sqlalchemy import bindparam, or_, select

from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.runtime.errors import ForbiddenError, SignInRequiredError
from app.services.runtime.ids import secret_hash
from app.services.studies import access
from app.services.studies.access import Right
from app.services.studies.session_modes import PREVIEW
from app.storage.models.arrivals import Reentry
from app.storage.models.studies import SessionRow, Study

_PREFIX = "preview."


def prefix_for(credential: str) -> str:
    """The beginning of the tokens of previews that are started with this sign-in or API token."""
    return f"{_PREFIX}{secret_hash(credential)}."


def is_other(app: AppContext, token: str) -> bool:
    """Whether the token is known, without a look at the database, to be no preview's."""
    return secret_hash(token) in app.other_tokens


def is_preview(app: AppContext, token: str) -> bool:
    """Whether the token belongs to a preview, whose credential may be in force or not."""
    return not is_other(app, token) and _slug_of_preview(app, token) is not None


def require_in_force(app: AppContext, token: str) -> None:
    """Raise ForbiddenError if this is the token of a preview whose credential is not in force."""
    slug = _slug_of_preview(app, token)
    if slug is None:
        return
    hashed = token.removeprefix(_PREFIX).partition(".")[0] if token.startswith(_PREFIX) else ""
    try:
        caller = accounts.by_credential_hash(app, hashed)
    except SignInRequiredError:
        caller = None
    if caller is None or not access.may(app, caller, slug, Right.CHANGE):
        raise ForbiddenError(
            f"expected the sign-in or API token with which this preview of {slug!r} was started to"
            " be in force, and its account to be an experimenter of the study"
        )


def _slug_of_preview(app: AppContext, token: str) -> str | None:
    hashed = secret_hash(token)
    with app.database.read() as db:
        found = db.execute(_STUDY_AND_MODE, {"hashed": hashed}).first()
    if found is None:
        return None
    if found.mode != PREVIEW:
        app.other_tokens.add(hashed)
        return None
    slug: str = found.slug
    return slug


# Built once: building it takes longer than executing it.
_STUDY_AND_MODE = (
    select(Study.slug, SessionRow.mode)
    .join(SessionRow, SessionRow.study_id == Study.id)
    .where(
        or_(
            SessionRow.token_hash == bindparam("hashed"),
            SessionRow.id.in_(
                select(Reentry.session_id).where(Reentry.token_hash == bindparam("hashed"))
            ),
        )
    )
)
