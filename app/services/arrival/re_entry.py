"""The same person coming twice: what a platform's ids can prove, and what they cannot.

A platform's name for a person is no secret: other requesters know it. So it alone leads nobody into
a session. Its name for this one submission is, like the receipt code: with both, and by a press, a
person is taken back into their session. What happens then is the study's `recruitment.returning`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sqlalchemy import delete, select
from sqlalchemy.orm import Session, joinedload

from app.services.context import AppContext
from app.services.runtime.errors import AlreadyTakenPartError, KnownPersonError, NotFoundError
from app.services.runtime.ids import new_secret, receipt_code, receipt_hash, secret_hash
from app.services.sessions import completion, lookup, receipts
from app.services.sessions import state_view as session_state
from app.services.studies import repository
from app.storage.models.arrivals import Reentry
from app.storage.models.studies import Identity, Participant, SessionRow
from app.study import recruitment as rules
from app.study.plan import Plan

#: The mode of the sessions that pages begin.
_LIVE = "live"


def require_unknown(app: AppContext, slug: str, ids: Mapping[str, str]) -> None:
    """Let a newcomer pass, and write nothing.

    Raises KnownPersonError or AlreadyTakenPartError if somebody of these ids has a session, and
    SessionTooOldError if they were away for too long to go on or to begin another one.
    """
    with app.database.read() as db:
        study = repository.read(db, slug)
        refuse_if_known(app, db, study, ids)


def refuse_if_known(
    app: AppContext, db: Session, study: repository.StudyInfo, ids: Mapping[str, str]
) -> None:
    """As `require_unknown`, within a transaction."""
    earlier = earlier_session(db, study, _LIVE, ids)
    if earlier is None:
        return
    proven = names_its_submission(db, study.plan, earlier, ids)
    refuse_if_blocked(db, study.plan, earlier, is_proven=proven)
    if may_go_on(app, study.plan, earlier):
        raise KnownPersonError(
            "expected a person who has not begun this study, and somebody of this id has",
            may_resume=proven,
        )


def come_back(app: AppContext, slug: str, ids: Mapping[str, str]) -> str:
    """A token for another browser of the person, who is known by their submission's id.

    Raises KnownPersonError where the ids prove nothing, NotFoundError where they name nobody, and
    AlreadyTakenPartError where the study lets nobody in twice.
    """
    token = new_secret()
    with app.database.write() as db:
        study = repository.read(db, slug)
        earlier = earlier_session(db, study, _LIVE, ids)
        if earlier is None:
            raise NotFoundError("expected ids of somebody who has begun this study")
        proven = names_its_submission(db, study.plan, earlier, ids)
        refuse_if_blocked(db, study.plan, earlier, is_proven=proven)
        if not proven or not may_go_on(app, study.plan, earlier):
            raise KnownPersonError(
                "expected the id of the submission under which the session began",
                may_resume=False,
            )
        take_back(app, db, earlier, token, is_full=False)
    return token


def come_back_by_receipt(app: AppContext, slug: str, receipt: str) -> str:
    """A token for another browser of the person, who has the receipt code of the session.

    Raises NotFoundError where no session of the study has it.
    """
    token = new_secret()
    with app.database.write() as db:
        row = receipts.session_of_receipt(db, slug, receipt)
        if row is None:
            raise NotFoundError("expected a receipt code of this study, and nothing is kept for it")
        take_back(app, db, row, token, is_full=True)
    return token


def earlier_session(
    db: Session, study: repository.StudyInfo, mode: str, ids: Mapping[str, str]
) -> SessionRow | None:
    """The session of the person of these ids; None if there is none.

    Of several, the newest of this very submission; else the newest.
    """
    person = rules.person(study.plan.recruitment, ids)
    if person is None:
        return None
    key, value = person
    found: Sequence[SessionRow] = db.scalars(
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
        .options(joinedload(SessionRow.plan), joinedload(SessionRow.study))
    ).all()
    for row in found:
        if names_its_submission(db, study.plan, row, ids):
            return row
    return found[0] if found else None


def names_its_submission(
    db: Session, plan: Plan, session: SessionRow, ids: Mapping[str, str]
) -> bool:
    """Whether the ids hold the platform's unguessable name of this session's submission."""
    submission = rules.submission(plan.recruitment, ids)
    if submission is None:
        return False
    key, value = submission
    return completion.ids_of(db, session.participant_id).get(key) == value


def may_go_on(app: AppContext, plan: Plan, earlier: SessionRow) -> bool:
    """Whether a person is taken back into this session, rather than beginning another one.

    Raises SessionTooOldError if they were away for too long to do either.
    """
    its_plan, now = repository.stored_plan(earlier.plan), app.now()
    if its_plan.resume.policy == "block":
        lookup.refuse_if_too_old(its_plan, earlier, now)
    if lookup.is_too_old(its_plan, earlier, now):
        return False
    ended = earlier.stage in session_state.ENDED
    return plan.recruitment.returning == "resume" and (ended or app.now() < earlier.expires_at)


def refuse_if_blocked(db: Session, plan: Plan, earlier: SessionRow, *, is_proven: bool) -> None:
    """Raises AlreadyTakenPartError if the study does not let this person in again.

    is_proven: whether it is known to be them: only they are told the way back of their session.
    """
    if plan.recruitment.returning != "block":
        return
    is_over = earlier.stage in session_state.ENDED
    way_back = None
    if is_over and is_proven:
        # Whoever comes back for a code that they did not note is not kept from it.
        way_back = completion.at_the_end(db, earlier, repository.stored_plan(earlier.plan))
    raise AlreadyTakenPartError(
        "this participant has a session of this study, and it takes each person once",
        is_over=is_over,
        way_back=way_back,
    )


def take_back(
    app: AppContext, db: Session, session: SessionRow, token: str, *, is_full: bool
) -> None:
    """Let another browser into the session, in place of the one that came back before it.

    The browser in which the session began, and its receipt, stay good. is_full: whether the new
    browser may do all that the first one may, with a receipt of its own: it may see no receipt and
    delete nothing where only a platform's ids led it here.
    """
    db.execute(delete(Reentry).where(Reentry.session_id == session.id))
    db.add(
        Reentry(
            session_id=session.id,
            token_hash=secret_hash(token),
            # No code leads to the hash of a secret that nobody was told.
            receipt_hash=receipt_hash(receipt_code(token))
            if is_full
            else secret_hash(new_secret()),
            created_at=app.now(),
        )
    )


def write_ids(app: AppContext, db: Session, participant_id: int, ids: Mapping[str, str]) -> None:
    """Keep these ids, but for those of which the participant has one already."""
    known = completion.ids_of(db, participant_id)
    db.add_all(
        Identity(participant_id=participant_id, key=key, value=value, created_at=app.now())
        for key, value in ids.items()
        if key not in known
    )
