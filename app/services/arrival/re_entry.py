"""Recognises returning participants, and lets them re-enter their session from another browser.

A platform's id of a person is no secret, since other requesters on the platform know it, so it does
not lead into a session. The platform's id of the submission is unguessable, and so is the receipt
code: either of them lets a person resume their session by pressing a button.
`recruitment.returning` in the study's plan decides what else happens.
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

#: The mode of sessions that participants start on the pages.
_LIVE = "live"


def require_unknown(app: AppContext, slug: str, ids: Mapping[str, str]) -> None:
    """Raise if a person with these ids may not start a new session. Writes nothing.

    Raises KnownPersonError or AlreadyTakenPartError if a session with these ids exists, and
    SessionTooOldError if it is too old to resume and the study does not allow a restart.
    """
    with app.database.read() as db:
        study = repository.read(db, slug)
        refuse_if_known(app, db, study, ids)


def refuse_if_known(
    app: AppContext, db: Session, study: repository.StudyInfo, ids: Mapping[str, str]
) -> None:
    """As `require_unknown`, within the transaction of `db`."""
    earlier = earlier_session(db, study, _LIVE, ids)
    if earlier is None:
        return
    proven = has_submission_id(db, study.plan, earlier, ids)
    refuse_if_blocked(db, study.plan, earlier, is_proven=proven)
    if may_resume(app, study.plan, earlier):
        raise KnownPersonError(
            "expected a person who has not begun this study, and somebody of this id has",
            may_resume=proven,
        )


def resume_by_ids(app: AppContext, slug: str, ids: Mapping[str, str]) -> str:
    """Issue a token for another browser of the person, who is identified by the submission's id.

    Raises KnownPersonError if the ids prove nothing, NotFoundError if no session has them, and
    AlreadyTakenPartError if the study does not admit a person twice.
    """
    token = new_secret()
    with app.database.write() as db:
        study = repository.read(db, slug)
        earlier = earlier_session(db, study, _LIVE, ids)
        if earlier is None:
            raise NotFoundError("expected ids of somebody who has begun this study")
        proven = has_submission_id(db, study.plan, earlier, ids)
        refuse_if_blocked(db, study.plan, earlier, is_proven=proven)
        if not proven or not may_resume(app, study.plan, earlier):
            raise KnownPersonError(
                "expected the id of the submission under which the session began",
                may_resume=False,
            )
        issue_token(app, db, earlier, token, is_full=False)
    return token


def resume_by_receipt(app: AppContext, slug: str, receipt: str) -> str:
    """Issue a token for another browser of the person, who is identified by the receipt code.

    Raises NotFoundError if no live session of the study has this code.
    """
    token = new_secret()
    with app.database.write() as db:
        row = receipts.session_of_receipt(db, slug, receipt)
        # A preview or pilot would go on at a participant's address without saying what it is.
        if row is None or row.mode != _LIVE:
            raise NotFoundError("expected a receipt code of this study, and nothing is kept for it")
        issue_token(app, db, row, token, is_full=True)
    return token


def earlier_session(
    db: Session, study: repository.StudyInfo, mode: str, ids: Mapping[str, str]
) -> SessionRow | None:
    """The session of the person with these ids, or None.

    Of several, the newest of this submission; else the newest.
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
        if has_submission_id(db, study.plan, row, ids):
            return row
    return found[0] if found else None


def has_submission_id(db: Session, plan: Plan, session: SessionRow, ids: Mapping[str, str]) -> bool:
    """Whether the ids include the platform's unguessable id of this session's submission."""
    submission = rules.submission(plan.recruitment, ids)
    if submission is None:
        return False
    key, value = submission
    return completion.ids_of(db, session.participant_id).get(key) == value


def may_resume(app: AppContext, plan: Plan, earlier: SessionRow) -> bool:
    """Whether a person resumes this session instead of starting another one.

    Raises SessionTooOldError if it is too old and the study allows neither.
    """
    its_plan, now = repository.stored_plan(earlier.plan), app.now()
    if its_plan.resume.policy == "block":
        lookup.refuse_if_too_old(its_plan, earlier, now)
    if lookup.is_too_old(its_plan, earlier, now):
        return False
    ended = earlier.stage in session_state.ENDED
    return plan.recruitment.returning == "resume" and (ended or app.now() < earlier.expires_at)


def refuse_if_blocked(db: Session, plan: Plan, earlier: SessionRow, *, is_proven: bool) -> None:
    """Raise AlreadyTakenPartError if the study does not admit this person again.

    is_proven: whether the person's identity is proven; only then does the error carry the session's
    return link.
    """
    if plan.recruitment.returning != "block":
        return
    is_over = earlier.stage in session_state.ENDED
    way_back = None
    if is_over and is_proven:
        # A person who did not note their completion code can still get it.
        way_back = completion.at_the_end(db, earlier, repository.stored_plan(earlier.plan))
    raise AlreadyTakenPartError(
        "this participant has a session of this study, and it takes each person once",
        is_over=is_over,
        way_back=way_back,
    )


def issue_token(
    app: AppContext, db: Session, session: SessionRow, token: str, *, is_full: bool
) -> None:
    """Store a token with which another browser may enter the session; it replaces an earlier one.

    The browser that started the session and its receipt code stay valid. is_full: whether the new
    browser has all rights and a receipt code of its own; one that was let in by platform ids can
    neither see a receipt nor delete data.
    """
    db.execute(delete(Reentry).where(Reentry.session_id == session.id))
    db.add(
        Reentry(
            session_id=session.id,
            token_hash=secret_hash(token),
            # A hash that no receipt code has.
            receipt_hash=receipt_hash(receipt_code(token))
            if is_full
            else secret_hash(new_secret()),
            created_at=app.now(),
        )
    )


def write_ids(app: AppContext, db: Session, participant_id: int, ids: Mapping[str, str]) -> None:
    """Store these ids of a participant, except for keys that are stored already."""
    known = completion.ids_of(db, participant_id)
    db.add_all(
        Identity(participant_id=participant_id, key=key, value=value, created_at=app.now())
        for key, value in ids.items()
        if key not in known
    )
