"""What people take away at the end of a session: a platform's code, and the way back to it.

A code is shown only once everything is stored: whoever reads a session's state sees what was
committed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.storage.tables import Identity, SessionRow
from app.study import recruitment as rules
from app.study.identifiers import Given, UnreadableIdError
from app.study.plan import Plan
from app.study.protocol import Stage
from app.study.recruitment import Outcome

from . import studies
from .errors import IdsRefusedError
from .studio import Studio

#: What each way of ending means to a platform.
OUTCOMES: Mapping[Stage, Outcome] = {
    Stage.COMPLETED: "completed",
    Stage.SCREENED_OUT: "screened_out",
    Stage.DECLINED: "declined",
    Stage.WITHDRAWN: "withdrawn",
}


def in_link(studio: Studio, slug: str, came: Iterable[tuple[str, str]]) -> Given:
    """What may be kept of a link's parameters. Raises NotFoundError or IdsRefusedError."""
    return read(studies.find(studio, slug).plan, came)


def read(plan: Plan, came: Iterable[tuple[str, str]]) -> Given:
    """What may be kept of the parameters that came. Raises IdsRefusedError."""
    try:
        return rules.read(plan.recruitment, came)
    except UnreadableIdError as error:
        raise IdsRefusedError(str(error)) from error


def at_the_end(session: Session, row: SessionRow, plan: Plan) -> dict[str, Any] | None:
    """The code and the way back of a session that has ended; None if there is neither."""
    outcome = OUTCOMES[Stage(row.stage)]
    return described(plan, outcome, ids_of(session, row.participant_id))


def described(
    plan: Plan, outcome: Outcome, ids: Mapping[str, str] | None = None
) -> dict[str, Any] | None:
    """The code and the way back as a page and the API say it."""
    found = rules.way_back(plan.recruitment, outcome, ids or {})
    if found is None:
        return None
    described: dict[str, Any] = {
        "code": found.code,
        "url": found.url,
        "platform": plan.recruitment.label,
    }
    if found.fields:
        described["fields"] = dict(found.fields)
    return described


def ids_of(session: Session, participant_id: int) -> dict[str, str]:
    """What a platform calls this person."""
    rows = session.scalars(select(Identity).where(Identity.participant_id == participant_id))
    return {row.key: row.value for row in rows}
