"""The database defends the data even where the code is wrong."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import pytest
from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.storage.models.studies import (
    Acquired,
    Base,
    Candidate,
    Event,
    Participant,
    PlanVersion,
    PreferenceRow,
    QueryRow,
    Recording,
    Response,
    SessionRow,
    Study,
    Trial,
)

NOW = datetime(2026, 3, 1, tzinfo=UTC)


def study(**changes: Any) -> Study:
    return Study(**{"id": 1, "slug": "s", "status": "open", "created_at": NOW, **changes})


def session_row(**changes: Any) -> SessionRow:
    values: dict[str, Any] = {
        "public_id": "S-1",
        "study_id": 1,
        "plan_id": 1,
        "participant_id": 1,
        "token_hash": "h",
        "mode": "live",
        "language": "en",
        "seed": 1,
        "order_index": 0,
        "trial_conditions": [0],
        "stage": "query",
        "trial_index": 0,
        "query_index": 0,
        "started_at": NOW,
        "last_seen_at": NOW,
        "expires_at": NOW,
    }
    return SessionRow(**{**values, **changes})


def other_session(**changes: Any) -> SessionRow:
    return session_row(public_id="S-2", token_hash="i", **changes)


def query(**changes: Any) -> QueryRow:
    values: dict[str, Any] = {
        "public_id": "q",
        "trial_id": 1,
        "query_index": 0,
        "trial_type": "random",
        "left_candidate": 0,
        "right_candidate": 1,
        "left_recording_id": 1,
        "right_recording_id": 2,
        "acquisition": "random",
        "seed": 1,
        "engine_version": "1",
        "created_at": NOW,
    }
    return QueryRow(**{**values, **changes})


def other_query(**changes: Any) -> QueryRow:
    return query(public_id="p", query_index=1, **changes)


def response(**changes: Any) -> Response:
    values: dict[str, Any] = {"query_id": 1, "response": "left", "rt_ms": 1.0, "answered_at": NOW}
    return Response(**{**values, **changes})


def preference(**changes: Any) -> PreferenceRow:
    values: dict[str, Any] = {
        "trial_id": 1,
        "preference_index": 0,
        "winner": 0,
        "loser": 1,
        "origin": "answer",
        "query_index": 0,
    }
    return PreferenceRow(**{**values, **changes})


def event(**changes: Any) -> Event:
    values: dict[str, Any] = {
        "session_id": 1,
        "trial_index": 0,
        "query_index": 0,
        "event": "playing",
        "time_ms": 1.0,
    }
    return Event(**{**values, **changes})


def recording(**changes: Any) -> Recording:
    values: dict[str, Any] = {
        "candidate_id": 1,
        "run_index": 0,
        "public_id": "r",
        "source": "crane",
        "locator": "env1/0/0",
        "duration_s": 10.0,
    }
    return Recording(**{**values, **changes})


@pytest.fixture
def stocked(app: AppContext) -> AppContext:
    """A studio with a session at its first query, which is answered."""
    with app.database.write() as db:
        db.add(study())
        db.flush()
        db.add(
            PlanVersion(
                id=1, study_id=1, version=1, plan_hash="h", plan={}, texts={}, created_at=NOW
            )
        )
        for index in (0, 1):
            place: dict[str, Any] = {
                "id": index + 1,
                "study_id": 1,
                "candidate_index": index,
                "parameters": {},
            }
            db.add(Candidate(environment="env1", **place))
        db.add(Participant(id=1, study_id=1, pseudonym="P-1", created_at=NOW))
        db.flush()
        db.add(recording(id=1))
        db.add(recording(id=2, candidate_id=2, public_id="r2"))
        db.add(session_row(id=1))
        db.flush()
        db.add(
            Trial(
                id=1,
                session_id=1,
                trial_index=0,
                condition="c",
                method="pbpo",
                environment="env1",
                seed=1,
                started_at=NOW,
            )
        )
        db.flush()
        db.add(query(id=1))
        db.flush()
        db.add_all([response(id=1), preference(id=1)])
        acquired = {"trial_id": 1, "query_index": 0, "candidate": 0}
        db.add(Acquired(id=1, **acquired))
    return app


#: What each database says: SQLite names columns where a row is there already, and no foreign key.
REFUSED: list[tuple[str, str, Callable[[], Base]]] = [
    ("studies.slug", "uq_studies_slug", lambda: study(id=2)),
    ("", "ck_studies_status", lambda: study(id=2, slug="other", status="ajar")),
    ("sessions.token_hash", "uq_sessions_token_hash", lambda: session_row(public_id="S-2")),
    ("", "ck_sessions_mode", lambda: other_session(mode="dream")),
    ("", "ck_sessions_stage", lambda: other_session(stage="lunch")),
    ("", "ck_sessions_position", lambda: other_session(query_index=-1)),
    ("queries.query_index", "uq_queries_trial_id_query_index", lambda: query(public_id="p")),
    ("queries.public_id", "uq_queries_public_id", lambda: query(query_index=1)),
    ("", "ck_queries_two_candidates", lambda: other_query(right_candidate=0)),
    ("", "ck_queries_query_index", lambda: query(public_id="p", query_index=-1)),
    (
        "FOREIGN KEY",
        "fk_queries_left_recording_id_recordings",
        lambda: other_query(left_recording_id=99),
    ),
    ("responses.query_id", "uq_responses_query_id", lambda: response(response="right")),
    ("FOREIGN KEY", "fk_responses_query_id_queries", lambda: response(query_id=99)),
    ("", "ck_responses_response", lambda: response(query_id=99, response="both")),
    ("", "ck_responses_rt", lambda: response(query_id=99, rt_ms=-1.0)),
    ("preferences.preference_index", "uq_preferences_trial_id_preference_index", preference),
    ("", "ck_preferences_origin", lambda: preference(preference_index=1, origin="guess")),
    ("", "ck_preferences_two_candidates", lambda: preference(preference_index=1, winner=1)),
    ("", "ck_events_side", lambda: event(side="top")),
    (
        "recordings.run_index",
        "uq_recordings_candidate_id_run_index",
        lambda: recording(public_id="r3"),
    ),
    ("", "ck_recordings_source", lambda: recording(public_id="r3", run_index=1, source="dream")),
]


@pytest.mark.parametrize(
    ("on_sqlite", "constraint", "row"), REFUSED, ids=[name for _, name, _ in REFUSED]
)
def test_a_row_that_cannot_be_is_refused_by_a_named_constraint(
    stocked: AppContext, on_sqlite: str, constraint: str, row: Callable[[], Base]
) -> None:
    said = (stocked.database.is_sqlite and on_sqlite) or constraint
    made: Any = row()
    # PostgreSQL would count from one, where a row is already.
    made.id = made.id or 99
    with pytest.raises(IntegrityError, match=said), stocked.database.write() as db:
        db.add(made)


def test_deleting_a_participant_takes_all_of_theirs_along(stocked: AppContext) -> None:
    with stocked.database.write() as db:
        db.execute(Participant.__table__.delete())  # type: ignore[attr-defined]
    with stocked.database.read() as db:
        for table in (SessionRow, Trial, QueryRow, Response, PreferenceRow, Acquired):
            assert _count(db, table) == 0, table.__tablename__
        assert _count(db, Study) == 1
        assert _count(db, Recording) == 2


def _count(db: Session, table: type[Base]) -> int:
    return len(db.execute(select(table)).all())
