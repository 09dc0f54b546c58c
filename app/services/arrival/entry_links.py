"""Single-use entry links of a study, which admit one person each. Only their hashes are stored."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, EntryLinkError
from app.services.runtime.ids import new_secret, secret_hash
from app.services.studies import repository
from app.storage.models.arrivals import EntryLink
from app.study.plan import Plan

#: More links in one call are taken for a typing error.
MOST_AT_ONCE = 10_000


@dataclass(frozen=True)
class Counts:
    """The number of links that a study has issued, and of those that were used."""

    made: int
    used: int


def create(
    app: AppContext, slug: str, count: int, label: str = "", actor: str = audit_log.COMMAND_LINE
) -> list[str]:
    """Create `count` links and return their paths, which are not stored.

    Raises NotFoundError, or ConflictError if the study does not use single-use links or the count
    is out of range.
    """
    if not 1 <= count <= MOST_AT_ONCE:
        raise ConflictError(f"expected a number of links from 1 to {MOST_AT_ONCE}, got {count}")
    tokens = [new_secret() for _ in range(count)]
    with app.database.write() as db:
        study = repository.read(db, slug)
        if not required(study.plan):
            raise ConflictError(
                f"expected a study with `recruitment: {{links: single-use}}`, and {slug!r} lets "
                "everybody in who has its link"
            )
        now = app.now()
        db.add_all(
            EntryLink(study_id=study.id, token_hash=secret_hash(token), label=label, created_at=now)
            for token in tokens
        )
        audit_log.note(db, now, actor, "links made", slug, count=count, label=label)
    return [f"/s/{slug}?entry={token}" for token in tokens]


def counts(app: AppContext, study_id: int) -> Counts:
    """The number of issued and used links of a study."""
    with app.database.read() as db:
        made, used = db.execute(
            select(func.count(EntryLink.id), func.count(EntryLink.used_at)).where(
                EntryLink.study_id == study_id
            )
        ).one()
    return Counts(made, used)


def required(plan: Plan) -> bool:
    """Whether the plan admits participants by single-use links only."""
    return plan.recruitment.links == "single-use"


def require_unused(db: Session, study: repository.StudyInfo, token: str | None) -> None:
    """Raise EntryLinkError if the study needs an entry link and this one is unknown or used."""
    if not required(study.plan):
        return
    if not token:
        raise EntryLinkError(
            "expected a personal link, and this one is the same for everybody", is_used=False
        )
    row = db.execute(
        select(EntryLink.used_at).where(
            EntryLink.study_id == study.id, EntryLink.token_hash == secret_hash(token)
        )
    ).one_or_none()
    if row is None:
        raise EntryLinkError("expected a link that this study gave out", is_used=False)
    if row.used_at is not None:
        raise EntryLinkError("expected a link that nobody has used yet", is_used=True)


def redeem(db: Session, study: repository.StudyInfo, token: str | None, now: datetime) -> None:
    """Mark the link as used. Of two simultaneous calls one raises EntryLinkError."""
    require_unused(db, study, token)
    if not required(study.plan) or token is None:
        return
    marked = db.execute(
        update(EntryLink)
        .where(
            EntryLink.study_id == study.id,
            EntryLink.token_hash == secret_hash(token),
            EntryLink.used_at.is_(None),
        )
        # The day alone: the exact time is that of the session's start, and would tell whose it is.
        .values(used_at=now.replace(hour=0, minute=0, second=0, microsecond=0))
        .returning(EntryLink.id)
    )
    if marked.scalar_one_or_none() is None:
        raise EntryLinkError("expected a link that nobody has used yet", is_used=True)
