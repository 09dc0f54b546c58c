"""The end of a session: the platform's completion code and the return link.

A code is shown only after everything is committed, since the state is read from the database.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import IdsRefusedError
from app.services.studies import repository
from app.storage.models.studies import Identity, QueryRow, Response, SessionRow, Trial
from app.study import recruitment as rules
from app.study.identifiers import Given, UnreadableIdError
from app.study.plan import Plan
from app.study.recruitment import Outcome
from app.study.stages import Stage

#: The outcome that each final stage has for a platform.
OUTCOMES: Mapping[Stage, Outcome] = {
    Stage.COMPLETED: "completed",
    Stage.SCREENED_OUT: "screened_out",
    Stage.DECLINED: "declined",
    Stage.WITHDRAWN: "withdrawn",
}


def in_link(app: AppContext, slug: str, came: Iterable[tuple[str, str]]) -> Given:
    """The ids to be stored, out of a link's parameters. Raises NotFoundError or IdsRefusedError."""
    return read(repository.find(app, slug).plan, came)


def read(plan: Plan, came: Iterable[tuple[str, str]]) -> Given:
    """The ids to be stored, out of the parameters that came. Raises IdsRefusedError."""
    try:
        return rules.read(plan.recruitment, came)
    except UnreadableIdError as error:
        raise IdsRefusedError(str(error)) from error


def at_the_end(db: Session, session: SessionRow, plan: Plan) -> dict[str, Any] | None:
    """The code and return link of an ended session; None if the study has neither.

    Who stops while a pair is not recorded yet leaves for a technical reason.
    """
    outcome = OUTCOMES[Stage(session.stage)]
    ids = ids_of(db, session.participant_id)
    way_back = rules.described(plan.recruitment, outcome, ids)
    if outcome == "withdrawn" and _waited_for_a_recording(db, session):
        return rules.described(plan.recruitment, "technical", ids) or way_back
    return way_back


def ids_of(db: Session, participant_id: int) -> dict[str, str]:
    """The platform ids of a participant, by their keys."""
    rows = db.scalars(select(Identity).where(Identity.participant_id == participant_id))
    return {row.key: row.value for row in rows}


def _waited_for_a_recording(db: Session, session: SessionRow) -> bool:
    """Whether the session's open query had no videos yet when the person stopped."""
    waiting = (
        select(QueryRow.id)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .outerjoin(Response, Response.query_id == QueryRow.id)
        .where(
            Trial.session_id == session.id,
            Trial.trial_index == session.trial_index,
            Response.id.is_(None),
            QueryRow.set_aside_at.is_(None),
            or_(QueryRow.left_recording_id.is_(None), QueryRow.right_recording_id.is_(None)),
        )
    )
    return db.scalar(waiting.limit(1)) is not None
