"""Receipt codes: the session that a code belongs to, and the browsers that may see it."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session, joinedload

from app.services.context import AppContext
from app.services.runtime.ids import receipt_code, receipt_hash, secret_hash
from app.storage.models.arrivals import Reentry
from app.storage.models.studies import SessionRow, Study


def session_of_receipt(db: Session, slug: str, receipt: str) -> SessionRow | None:
    """The session of the study with this receipt code, or None."""
    hashed = receipt_hash(receipt)
    came_back = select(Reentry.session_id).where(Reentry.receipt_hash == hashed)
    return db.scalar(
        select(SessionRow)
        .join(Study, SessionRow.study_id == Study.id)
        .where(
            Study.slug == slug,
            (SessionRow.receipt_hash == hashed) | SessionRow.id.in_(came_back),
        )
        .options(joinedload(SessionRow.plan))
    )


def receipt(app: AppContext, token: str) -> str | None:
    """The receipt code of this token's browser.

    None for a browser that was let in by platform ids, or if no session has the token.
    """
    with app.database.read() as db:
        return receipt_code(token) if has_all_rights(db, token) else None


def has_all_rights(db: Session, token: str) -> bool:
    """Whether the holder of this token may see the receipt code and delete the person's data."""
    hashed = secret_hash(token)
    if db.scalar(select(SessionRow.id).where(SessionRow.token_hash == hashed)) is not None:
        return True
    of_receipt = select(Reentry.id).where(
        Reentry.token_hash == hashed, Reentry.receipt_hash == receipt_hash(receipt_code(token))
    )
    return db.scalar(of_receipt) is not None
