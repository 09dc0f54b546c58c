"""The same person coming twice: recognised by what their platform calls them.

What happens then is the study's `recruitment.returning`: they are taken back into their session, or
not let in, or begin another session as the same participant.
"""

from __future__ import annotations

from collections.abc import Mapping

from sqlalchemy import select
from sqlalchemy.orm import Session, joinedload

from app.storage.arrivals import Reentry
from app.storage.tables import Identity, Participant, SessionRow
from app.study import recruitment as rules
from app.study.plan import Plan

from . import places, recruitment, sessions, studies
from . import state as session_state
from .errors import AlreadyTakenPartError, SessionExpiredError, SignInRequiredError
from .studio import Studio
from .tokens import new_secret, receipt_code, receipt_hash, secret_hash

#: The mode of the sessions that pages begin.
_LIVE = "live"


def come_back(studio: Studio, slug: str, ids: Mapping[str, str]) -> str | None:
    """A token for a browser whose person has a session to go on with; None for a newcomer.

    Raises AlreadyTakenPartError if the study does not let a person in twice.
    """
    with studio.database.read() as session:
        study = studies.read(session, slug)
        earlier = earlier_session(session, study, _LIVE, ids)
        if earlier is None:
            return None
        refuse_if_blocked(session, study.plan, earlier)
        if not may_go_on(studio, study.plan, earlier):
            return None
    token = new_secret()
    with studio.database.write() as session:
        row = earlier_session(session, study, _LIVE, ids)
        if row is None:
            # Deleted in the meantime.
            return None
        take_back(studio, session, row, token, ids)
    return token


def is_somebody_else(studio: Studio, token: str, ids: Mapping[str, str]) -> bool:
    """Whether a link names another person than the browser's session is of.

    On a shared computer the next person must not find the session of the last one.
    """
    with studio.database.read() as session:
        try:
            row = sessions.find(studio, session, token, even_expired=True)
        except (SignInRequiredError, SessionExpiredError):
            return False
        person = rules.person(studies.stored_plan(row.plan).recruitment, ids)
        if person is None:
            return False
        key, value = person
        return recruitment.ids_of(session, row.participant_id).get(key, value) != value


def earlier_session(
    session: Session, study: studies.StudyInfo, mode: str, ids: Mapping[str, str]
) -> SessionRow | None:
    """The newest session of the person of these ids; None if nobody is recognised."""
    person = rules.person(study.plan.recruitment, ids)
    if person is None:
        return None
    key, value = person
    return session.scalar(
        select(SessionRow)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .join(Identity, Identity.participant_id == Participant.id)
        .where(
            SessionRow.study_id == study.id,
            SessionRow.mode == mode,
            Identity.key == key,
            Identity.value == value,
        )
        .order_by(SessionRow.id.desc())
        .limit(1)
        .options(joinedload(SessionRow.plan), joinedload(SessionRow.study))
    )


def may_go_on(studio: Studio, plan: Plan, earlier: SessionRow) -> bool:
    """Whether a person is taken back into this session, rather than beginning another one.

    Raises SessionTooOldError if they were away for too long to do either.
    """
    its_plan, now = studies.stored_plan(earlier.plan), studio.now()
    if its_plan.resume.policy == "block":
        places.refuse_if_too_old(its_plan, earlier, now)
    if places.is_too_old(its_plan, earlier, now):
        return False
    ended = earlier.stage in session_state.ENDED
    return plan.recruitment.returning == "resume" and (ended or studio.now() < earlier.expires_at)


def refuse_if_blocked(session: Session, plan: Plan, earlier: SessionRow) -> None:
    """Raises AlreadyTakenPartError if the study does not let this person in again."""
    if plan.recruitment.returning != "block":
        return
    is_over = earlier.stage in session_state.ENDED
    way_back = None
    if is_over:
        # Whoever comes only for the code that they did not note is not kept from it.
        way_back = recruitment.at_the_end(session, earlier, studies.stored_plan(earlier.plan))
    raise AlreadyTakenPartError(
        "this participant has a session of this study, and it takes each person once",
        is_over=is_over,
        way_back=way_back,
    )


def take_back(
    studio: Studio, session: Session, row: SessionRow, token: str, ids: Mapping[str, str]
) -> None:
    """Let another browser into the session. The first one, and its receipt, stay good."""
    session.add(
        Reentry(
            session_id=row.id,
            token_hash=secret_hash(token),
            receipt_hash=receipt_hash(receipt_code(token)),
            created_at=studio.now(),
        )
    )
    write_ids(studio, session, row.participant_id, ids)


def write_ids(
    studio: Studio, session: Session, participant_id: int, ids: Mapping[str, str]
) -> None:
    """Keep these ids; of an earlier visit's ids those that have changed are replaced."""
    known = {
        row.key: row
        for row in session.scalars(
            select(Identity).where(Identity.participant_id == participant_id)
        )
    }
    for key, value in ids.items():
        if key in known:
            known[key].value = value
        else:
            session.add(
                Identity(
                    participant_id=participant_id, key=key, value=value, created_at=studio.now()
                )
            )
