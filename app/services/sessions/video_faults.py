"""Sets a query aside whose video did not play, and asks a replacement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.services.context import AppContext
from app.services.proposals.trial_schedule import replacement
from app.services.runtime.errors import AlreadyAnsweredError, ConflictError

from . import box_queries, box_trials, event_limits, lookup, queries, trial_start
from . import state_view as session_state
from .queries import ClientEvent
from .state_view import State

#: Attempts at one query. A browser that needs more plays no video at all.
MOST_ATTEMPTS = 20
#: Queries of one session that may be set aside. A browser that fails more often is unsuitable.
MOST_FAULTS = 100


@dataclass(frozen=True)
class FaultReport:
    """The report that a video of this query did not play, with the client events up to it."""

    query_id: str
    reason: str
    client_events: Sequence[ClientEvent] = ()
    left_out: int = 0


def report_fault(app: AppContext, token: str, report: FaultReport) -> State:
    """Set a query aside because a video did not play, and ask a replacement at the same index.

    The query that was set aside is kept, marked, and never used for training. A repeated report
    changes nothing. Raises AlreadyAnsweredError if the query has a response, OutOfOrder if it is no
    longer the open query, and ConflictError beyond the limits.
    """
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        query = queries.find(db, session, report.query_id)
        if query.set_aside_at is not None:
            return session_state.describe(app, db, session)
        if query.response is not None:
            raise AlreadyAnsweredError(
                "expected a query without a response, and this one is answered", session.stage
            )
        lookup.require_asked(session, query.query_index)
        tried = queries.read_attempts(db, query)
        if len(tried) >= MOST_ATTEMPTS:
            raise ConflictError(
                f"expected at most {MOST_ATTEMPTS} attempts at one query; none of them played"
            )
        if queries.number_set_aside(db, session) >= MOST_FAULTS:
            raise ConflictError(
                f"expected at most {MOST_FAULTS} pairs of a session that did not play, and there"
                " are as many"
            )
        trial = queries.trial_spec(
            session, query.trial.trial_index, query.trial.seed, query.engine_version
        )
        box = box_trials.trial_of(session, trial)
        if box is None:
            candidate_set = app.proposer.candidate_set(trial.study_id, trial.environment)
            instead = replacement(candidate_set, trial, tried, app.recordings.is_available)
        now = app.now()
        query.set_aside_at = now
        query.fault = report.reason
        event_limits.store(db, session, query, report.client_events, report.left_out, now)
        queries.close_events(db, session, query, "set_aside")
        if box is not None:
            box_queries.open_replacement(app, db, box, query.trial_id, tried, now)
            session.last_seen_at = now
            db.flush()
            return session_state.describe(app, db, session)
        db.add(trial_start.query_row(instead, now, trial_id=query.trial_id, attempt=len(tried)))
        session.last_seen_at = now
        db.flush()
        app.proposer.render([instead.left, instead.right])
        return session_state.describe(app, db, session)
