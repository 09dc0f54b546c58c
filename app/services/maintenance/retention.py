"""Retention: deletes sessions and ids of platforms when the plan's retention period has passed.

Each session is subject to the plan it began under. It is deleted in a transaction of its own, which
checks again that it is due; so responses are not delayed, and two runs at once do no harm. If one
study fails, the others are still processed, and the study's overview reports the failure. Simulated
sessions contain no personal data and are kept.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.failure_counter import FailureContext, Kind
from app.services.sessions import deletion
from app.services.studies.repository import stored_plan
from app.services.studies.session_modes import OF_PEOPLE
from app.storage.models.studies import Identity, Participant, PlanVersion, SessionRow, Study
from app.study.retention import Due, Retention, due

log = logging.getLogger(__name__)


@dataclass
class CleanupResult:
    """Numbers of deletions in one study (in a dry run: of what is due), and whether it failed."""

    sessions: int = 0
    people_without_ids: int = 0
    failed: bool = False


@dataclass
class _Found:
    """What is due in one study: ids of sessions, and of participants whose platform ids are due."""

    sessions: list[int] = field(default_factory=list)
    people: list[int] = field(default_factory=list)


def run(
    app: AppContext,
    *,
    dry_run: bool = False,
    actor: str = audit_log.RETENTION_RULE,
    stop: Callable[[], bool] = lambda: False,
) -> dict[str, CleanupResult]:
    """Delete what is due, or with dry_run only count it.

    Returns the results by slug, for studies where something was due or the deletion failed. stop:
    called before each deletion; True ends the run, and the next one continues.
    """
    with app.database.read() as db:
        slugs = db.scalars(select(Study.slug).order_by(Study.id)).all()
    found: dict[str, CleanupResult] = {}
    for slug in slugs:
        swept = CleanupResult()
        try:
            with app.database.read() as db:
                due_of = _due(app, db, slug)
            if dry_run:
                swept = CleanupResult(len(due_of.sessions), len(due_of.people))
            else:
                _delete_found(app, slug, due_of, swept, actor, stop)
        except Exception:
            log.exception("the retention sweep of %s failed", slug)
            swept.failed = True
            if not dry_run:
                app.failures.count(Kind.RETENTION, FailureContext(slug=slug))
        if swept != CleanupResult():
            found[slug] = swept
    app.failures.write()
    return found


def delete_due(app: AppContext, stop: Callable[[], bool]) -> int:
    """Delete what is due, log it by study, and return the number of deletions."""
    found = run(app, stop=stop)
    for slug, swept in found.items():
        log.info("retention of %s: %s", slug, swept)
    return sum(swept.sessions + swept.people_without_ids for swept in found.values())


def _due(app: AppContext, db: Session, slug: str) -> _Found:
    """What is due in a study; nothing if it has no rule or was deleted meanwhile."""
    found = _Found()
    study = db.scalar(select(Study).where(Study.slug == slug))
    if study is None:
        return found
    rules = {version.id: stored_plan(version).retention for version in study.plans}
    if all(rule == Retention() for rule in rules.values()):
        return found
    may_go: dict[int, bool] = {}
    rows = db.execute(
        select(
            SessionRow.id,
            SessionRow.participant_id,
            SessionRow.plan_id,
            SessionRow.ended_at,
            SessionRow.expires_at,
        )
        .where(SessionRow.study_id == study.id, SessionRow.mode.in_(OF_PEOPLE))
        .order_by(SessionRow.id)
    )
    for row_id, person, plan_id, ended_at, expires_at in rows:
        said = due(rules[plan_id], ended_at, expires_at, app.now())
        if said.everything:
            found.sessions.append(row_id)
        # Ids belong to a participant: they are kept as long as any of their sessions needs them.
        may_go[person] = may_go.get(person, True) and said.identities
    named = set(
        db.scalars(
            select(Identity.participant_id)
            .join(Participant, Identity.participant_id == Participant.id)
            .where(Participant.study_id == study.id)
        )
    )
    found.people = sorted(person for person in named if may_go.get(person, False))
    return found


def _delete_found(
    app: AppContext,
    slug: str,
    found: _Found,
    swept: CleanupResult,
    actor: str,
    stop: Callable[[], bool],
) -> None:
    """Delete what is due. swept: updated after each deletion, so it is right after an error."""
    seeds: frozenset[int] = frozenset()
    try:
        for person in found.people:
            if stop():
                break
            with app.database.write() as db:
                swept.people_without_ids += _delete_ids(app, db, person)
        for session_id in found.sessions:
            if stop():
                break
            with app.database.write() as db:
                gone = _delete_session(app, db, session_id)
            if gone is not None:
                swept.sessions += 1
                seeds |= gone
    finally:
        # Also after an error: the deletions before it are committed and must be logged.
        if swept != CleanupResult():
            audit_log.note_alone(
                app,
                actor,
                "retention carried out",
                slug,
                sessions_deleted=swept.sessions,
                people_whose_ids_were_deleted=swept.people_without_ids,
            )
            deletion.purge_traces(app, seeds)


def _delete_ids(app: AppContext, db: Session, person: int) -> int:
    """Delete a participant's ids if they are still due; returns 1 if there were any, else 0."""
    db.get(Participant, person, with_for_update=True)
    rows = db.scalars(select(SessionRow).where(SessionRow.participant_id == person)).all()
    if not all(_due_of(app, row).identities for row in rows):
        return 0
    gone = db.scalars(
        delete(Identity).where(Identity.participant_id == person).returning(Identity.id)
    ).all()
    return 1 if gone else 0


def _delete_session(app: AppContext, db: Session, session_id: int) -> frozenset[int] | None:
    """Delete a session, and return the seeds of its trials; None if it is gone or no longer due."""
    session = db.get(SessionRow, session_id, with_for_update=True)
    if session is None or not _due_of(app, session).everything:
        return None
    return deletion.delete_session(app, db, session, "retention")


def _due_of(app: AppContext, session: SessionRow) -> Due:
    version: PlanVersion = session.plan
    return due(stored_plan(version).retention, session.ended_at, session.expires_at, app.now())
