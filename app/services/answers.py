"""What comes back from the query page: a response, or that a video did not play.

What is stored is stored in one transaction: two tabs, a double click or a retry find that it was
done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.orm import Session
from sqlalchemy.orm.attributes import set_committed_value

from app.pbbo import allows_skip
from app.storage.insertion import insert_rows
from app.storage.tables import QueryRow, Response, SessionRow
from app.study import protocol
from app.study.protocol import Stage
from app.study.stages import PRACTICE_INDEX

from . import queries, seen_events, sessions, teachings, trials
from . import state as session_state
from .course import Record, Shown, following, learned, lessons, replacement, teaches
from .errors import (
    AlreadyAnsweredError,
    ConflictError,
    SetAsideError,
    SkipNotOfferedError,
    SkipReasonError,
)
from .proposals import NextQuery, Step, TrialInHand
from .queries import Happening, Standing
from .state import State
from .studies import stored_plan
from .studio import Studio
from .thoughts import History

#: Attempts at one place of a trial: whoever needs more will not see any video at all.
MOST_ATTEMPTS = 20
#: Pairs of one session that are set aside: a browser that shows so few videos shows no study.
MOST_FAULTS = 100


@dataclass(frozen=True)
class Answer:
    """What was pressed, and what the browser saw meanwhile."""

    query_id: str
    response: str
    rt_ms: float | None = None
    skip_reason: str | None = None
    happenings: Sequence[Happening] = ()
    #: How much more the browser saw than is told here.
    left_out: int = 0


@dataclass(frozen=True)
class FaultReport:
    """A video of this query did not play, and what the browser saw of that."""

    query_id: str
    reason: str
    happenings: Sequence[Happening] = ()
    left_out: int = 0


@dataclass(frozen=True)
class _Asked:
    """What one read tells of the query that is answered.

    record: the trial's answered queries, this one included.
    """

    trial: TrialInHand
    record: Record
    is_practice: bool

    @property
    def history(self) -> History:
        return learned(self.trial, self.record)


def respond(studio: Studio, token: str, answer: Answer) -> State:
    """Store a response with the query that follows it. Sent again, it changes nothing.

    One transaction reads what the response is about. The step after it comes from the cache or is
    computed, outside any transaction. One short transaction locks the session, checks again and
    writes. The state is described from what is known by then.
    """
    with studio.measurements.answering(answer.response):
        with studio.database.read() as session:
            row = sessions.find(studio, session, token)
            query = queries.find(session, row, answer.query_id)
            if not _is_new(row, query, answer):
                return session_state.describe(studio, session, row)
            asked = _read(session, row, query, answer)
        step = None if asked.is_practice else _step(studio, asked)
        with studio.database.write() as session:
            row = sessions.find(studio, session, token, to_write=True)
            query = queries.find(session, row, answer.query_id)
            opened = None
            if _is_new(row, query, answer):
                # The record that was read still holds: undoing a response before this one would
                # have deleted this query.
                opened = _store(studio, session, row, query, answer, asked, step)
        with studio.database.read() as session:
            if opened is None:
                row = sessions.find(studio, session, token)
            return session_state.describe(studio, session, row, opened)


def _read(session: Session, row: SessionRow, query: QueryRow, answer: Answer) -> _Asked:
    """Raises OutOfOrder, SkipNotOfferedError or SkipReasonError if the answer cannot be taken."""
    sessions.require_asked(row, query.query_index)
    trial = queries.trial_in_hand(
        row, query.trial.trial_index, query.trial.seed, query.engine_version
    )
    if answer.response == "skip" and not allows_skip(trial.method):
        raise SkipNotOfferedError("expected left or right: this query offers no skip", row.stage)
    _check_reason(row, query, answer)
    is_practice = query.trial.trial_index == PRACTICE_INDEX
    before = () if is_practice else queries.read_record(session, query.trial_id)
    return _Asked(trial, (*before, _shown(query, answer.response, answer.skip_reason)), is_practice)


def _step(studio: Studio, asked: _Asked) -> Step:
    """The precomputed step, or one computed now."""
    step = studio.proposer.cached_step(asked.trial, asked.history)
    studio.measurements.step_asked(ahead=step is not None)
    return step or studio.proposer.step(asked.trial, asked.history)


def _store(
    studio: Studio,
    session: Session,
    row: SessionRow,
    query: QueryRow,
    answer: Answer,
    asked: _Asked,
    step: Step | None,
) -> Standing | None:
    """Write the response, what it taught and what follows; the open query, if the trial goes on.

    Raises OutOfOrder, before anything is written, if the session's open query is another one.
    """
    now = studio.now()
    sessions.advance(studio, row, protocol.Responded(query_index=query.query_index, at=now))
    given = {
        "query_id": query.id,
        "response": answer.response,
        "skip_reason": answer.skip_reason,
        "rt_ms": answer.rt_ms,
        "answered_at": now,
        "plan_id": row.plan_id,
    }
    insert_rows(session, Response, [given])
    set_committed_value(query, "response", Response(**given))
    seen_events.keep(session, row, query, answer.happenings, answer.left_out, now)
    if step is None:
        _go_on_practising(studio, session, row, query, now)
        return None
    if teaches(asked.trial, query.trial_type):
        teachings.store(session, query, step, lessons(asked.trial, asked.record))
    if row.stage == Stage.QUERY and row.trial_index == query.trial.trial_index:
        space = studio.proposer.space(asked.trial.study_id, asked.trial.environment)
        coming = following(space, asked.trial, asked.record, step)
        assert coming is not None
        return _open(session, query, coming, asked.record, now)
    query.trial.ended_at = now
    trials.arrive(studio, session, row)
    return None


def _open(
    session: Session, answered: QueryRow, coming: NextQuery, record: Record, now: datetime
) -> Standing:
    """Store the trial's next query. record: all that was answered before it."""
    trial = answered.trial
    asked = trials.query_columns(coming, now, trial_id=trial.id)
    insert_rows(session, QueryRow, [asked])
    return Standing(
        trial_id=trial.id,
        trial_index=trial.trial_index,
        environment=trial.environment,
        seed=trial.seed,
        public_id=asked["public_id"],
        attempt=asked["attempt"],
        asked=Shown(
            query_index=coming.query_index,
            trial_type=coming.trial_type,
            left=coming.left_candidate,
            right=coming.right_candidate,
            left_recording=coming.left.id,
            right_recording=coming.right.id,
            acquisition=coming.acquisition,
            engine_version=coming.engine_version,
            repeats=coming.repeats,
            response=None,
        ),
        record=record,
        just_answered=answered,
    )


def _go_on_practising(
    studio: Studio, session: Session, row: SessionRow, query: QueryRow, now: datetime
) -> None:
    if row.stage == Stage.PRACTICE:
        coming = trials.practice_query(studio, row, row.query_index)
        session.add(trials.query_row(coming, now, trial_id=query.trial_id))
    else:
        query.trial.ended_at = now
        trials.arrive(studio, session, row)


def report_fault(studio: Studio, token: str, report: FaultReport) -> State:
    """Set a query aside because a video did not play, and put another one in its place.

    What is set aside is kept, marked, and never reaches the model. The same report again changes
    nothing. Raises AlreadyAnsweredError if the query has its response, and OutOfOrder if nobody is
    asked it any more.
    """
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        query = queries.find(session, row, report.query_id)
        if query.set_aside_at is not None:
            return session_state.describe(studio, session, row)
        if query.response is not None:
            raise AlreadyAnsweredError(
                "expected a query without a response, and this one is answered", row.stage
            )
        sessions.require_asked(row, query.query_index)
        tried = queries.read_attempts(session, query)
        if len(tried) >= MOST_ATTEMPTS:
            raise ConflictError(
                f"expected at most {MOST_ATTEMPTS} attempts at one query; none of them played"
            )
        if queries.number_set_aside(session, row) >= MOST_FAULTS:
            raise ConflictError(
                f"expected at most {MOST_FAULTS} pairs of a session that did not play, and there"
                " are as many"
            )
        trial = queries.trial_in_hand(
            row, query.trial.trial_index, query.trial.seed, query.engine_version
        )
        space = studio.proposer.space(trial.study_id, trial.environment)
        instead = replacement(space, trial, tried, studio.recordings.can_be_had)
        now = studio.now()
        query.set_aside_at = now
        query.fault = report.reason
        seen_events.keep(session, row, query, report.happenings, report.left_out, now)
        queries.close_events(session, row, query, "set_aside")
        session.add(trials.query_row(instead, now, trial_id=query.trial_id, attempt=len(tried)))
        row.last_seen_at = now
        session.flush()
        studio.proposer.render([instead.left, instead.right])
        return session_state.describe(studio, session, row)


def _is_new(row: SessionRow, query: QueryRow, answer: Answer) -> bool:
    """Whether the query is still to be answered; raises if it was answered otherwise."""
    if query.set_aside_at is not None:
        raise SetAsideError(
            "expected a response to the query that took this one's place: this one did not play",
            row.stage,
        )
    if query.response is None:
        return True
    if query.response.response != answer.response:
        raise AlreadyAnsweredError(
            f"expected {query.response.response!r} again, the response this query has, "
            f"got {answer.response!r}",
            row.stage,
        )
    return False


def _check_reason(row: SessionRow, query: QueryRow, answer: Answer) -> None:
    """A reason goes with a skip, and is one of those that the study offers.

    A skip without a reason is taken: a page that was open before knows of none.
    """
    if answer.skip_reason is None:
        return
    if answer.response != "skip":
        raise SkipReasonError(
            f"expected a reason with a skip only, got one with {answer.response!r}", row.stage
        )
    plan = stored_plan(row.plan)
    # The practice has the skip button of the first trial.
    skip = plan.conditions[row.trial_conditions[max(query.trial.trial_index, 0)]].skip
    offered = list(skip.reasons or ()) if skip else []
    if offered and answer.skip_reason not in offered:
        raise SkipReasonError(
            f"expected one of {', '.join(offered)}, got {answer.skip_reason!r}", row.stage
        )


def _shown(query: QueryRow, response: str, skip_reason: str | None) -> Shown:
    return Shown(
        query_index=query.query_index,
        trial_type=query.trial_type,
        left=query.left_candidate,
        right=query.right_candidate,
        left_recording=query.left_recording_id,
        right_recording=query.right_recording_id,
        acquisition=query.acquisition,
        engine_version=query.engine_version,
        repeats=query.repeats_query_index,
        response=response,
        skip_reason=skip_reason,
    )
