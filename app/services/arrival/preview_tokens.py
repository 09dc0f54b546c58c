"""Tokens of previews, which name the sign-in or API token with which the preview was started.

A program that sends a preview's token as a bearer token is answered as long as that credential is
in force and its account may change the study. The browser's pages check the sign-in themselves.
"""

from __future__ import annotations

from sqlalchemy import or_, select

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
    entered_again = select(Reentry.session_id).where(Reentry.token_hash == hashed)
    statement = (
        select(Study.slug)
        .join(SessionRow, SessionRow.study_id == Study.id)
        .where(
            or_(SessionRow.token_hash == hashed, SessionRow.id.in_(entered_again)),
            SessionRow.mode == PREVIEW,
        )
    )
    with app.database.read() as db:
        return db.scalar(statement)
