"""Whose a study is, and whom it is shared with."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Select, select

from app.storage.accounts import Account, StudyAccess

from . import accounts, audit, studies
from .accounts import Role
from .errors import ConflictError, NotFoundError
from .studio import Studio


@dataclass(frozen=True)
class Tie:
    """An account that has to do with a study: its owner, or somebody it is shared with."""

    account_id: int
    email: str
    is_owner: bool
    is_disabled: bool
    since: datetime


def ties(studio: Studio, slug: str) -> list[Tie]:
    """The owner first, then the others by address."""
    with studio.database.read() as session:
        study = studies.read(session, slug)
        rows = session.execute(
            select(StudyAccess, Account)
            .join(Account, StudyAccess.account_id == Account.id)
            .where(StudyAccess.study_id == study.id)
        ).all()
    found = [
        Tie(
            account.id,
            account.email,
            tie.access == studies.OWNER,
            account.disabled_at is not None,
            tie.created_at,
        )
        for tie, account in rows
    ]
    return sorted(found, key=lambda tie: (not tie.is_owner, tie.email))


def share(studio: Studio, slug: str, email: str, actor: str) -> None:
    """Share a study with an experimenter. Sharing twice changes nothing.

    Raises NotFoundError if nobody has the address, ConflictError for a reviewer.
    """
    with studio.database.write() as session:
        # Held: of two at once the second sees what the first has done.
        study = studies.to_change(session, slug)
        account = accounts.require(session, email)
        if account.role == Role.REVIEWER:
            raise ConflictError(
                f"expected an experimenter: {account.email} is a reviewer, and reads every design"
            )
        if session.scalar(_tie_of(study.id, account.id)) is not None:
            return
        session.add(
            StudyAccess(
                study_id=study.id,
                account_id=account.id,
                access=studies.SHARED,
                created_at=studio.now(),
            )
        )
        audit.note(session, studio.now(), actor, "study shared", slug, account=account.email)


def stop_sharing(studio: Studio, slug: str, account_id: int, actor: str) -> None:
    """Take a study back from somebody it is shared with. Raises NotFoundError."""
    with studio.database.write() as session:
        study = studies.read(session, slug)
        tie = session.scalar(_tie_of(study.id, account_id))
        if tie is None or tie.access != studies.SHARED:
            raise NotFoundError("expected somebody whom the study is shared with")
        account = session.get_one(Account, account_id)
        session.delete(tie)
        audit.note(session, studio.now(), actor, "sharing ended", slug, account=account.email)


def _tie_of(study_id: int, account_id: int) -> Select[StudyAccess]:
    return select(StudyAccess).where(
        StudyAccess.study_id == study_id, StudyAccess.account_id == account_id
    )
