"""What people take away at the end of a session: a platform's code, and the way back to it.

A code is shown only once everything is stored: whoever reads a session's state sees what was
committed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import IdsRefusedError
from app.services.studies import repository
from app.storage.models.studies import Identity, SessionRow
from app.study import recruitment as rules
from app.study.identifiers import Given, UnreadableIdError
from app.study.plan import Plan
from app.study.protocol import Stage
from app.study.recruitment import Outcome

#: What each way of ending means to a platform.
OUTCOMES: Mapping[Stage, Outcome] = {
    Stage.COMPLETED: "completed",
    Stage.SCREENED_OUT: "screened_out",
    Stage.DECLINED: "declined",
    Stage.WITHDRAWN: "withdrawn",
}


def in_link(app: AppContext, slug: str, came: Iterable[tuple[str, str]]) -> Given:
    """What may be kept of a link's parameters. Raises NotFoundError or IdsRefusedError."""
    return read(repository.find(app, slug).plan, came)


def read(plan: Plan, came: Iterable[tuple[str, str]]) -> Given:
    """What may be kept of the parameters that came. Raises IdsRefusedError."""
    try:
        return rules.read(plan.recruitment, came)
    except UnreadableIdError as error:
        raise IdsRefusedError(str(error)) from error


def at_the_end(db: Session, session: SessionRow, plan: Plan) -> dict[str, Any] | None:
    """The code and the way back of a session that has ended; None if there is neither."""
    outcome = OUTCOMES[Stage(session.stage)]
    return rules.described(plan.recruitment, outcome, ids_of(db, session.participant_id))


def ids_of(db: Session, participant_id: int) -> dict[str, str]:
    """What a platform calls this person."""
    rows = db.scalars(select(Identity).where(Identity.participant_id == participant_id))
    return {row.key: row.value for row in rows}
