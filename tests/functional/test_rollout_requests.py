"""Rollouts asked for and taken back by trials."""

from __future__ import annotations

import threading

import pytest
from sqlalchemy import select

from app.services.context import AppContext
from app.services.rollouts import requests
from app.services.sessions import deletion
from app.services.studies.repository import StudyInfo
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Candidate, QueryRow, Trial

from .machine_study import add_candidates, add_trial, ask

pytestmark = pytest.mark.usefixtures("short_study")


@pytest.fixture
def candidates(app: AppContext, short_study: StudyInfo) -> list[int]:
    return add_candidates(app, short_study.slug)


def statuses(app: AppContext) -> list[tuple[str, str, int]]:
    with app.database.read() as db:
        rows = db.scalars(select(Rollout).order_by(Rollout.id))
        return [(row.status, row.reason, row.priority) for row in rows]


def test_two_trials_that_need_the_same_candidate_wait_for_one_rollout(
    app: AppContext, candidates: list[int]
) -> None:
    trials = [add_trial(app, "short"), add_trial(app, "short")]
    asked = [ask(app, candidates[0], trial_id=trial) for trial in trials]
    assert asked[0] == asked[1]
    assert len(statuses(app)) == 1


def test_a_rollout_asked_ahead_is_moved_up_once_a_query_waits_for_it_and_never_down(
    app: AppContext, candidates: list[int]
) -> None:
    for reason, priority in ((requests.AHEAD, 12), (requests.QUERY, 0), (requests.AHEAD, 15)):
        ask(app, candidates[0], reason=reason, priority=priority)
    assert statuses(app) == [("asked", "query", 0)]


def test_a_trial_takes_back_only_what_it_asked_ahead_and_does_not_keep(
    app: AppContext, candidates: list[int]
) -> None:
    mine, others = add_trial(app, "short"), add_trial(app, "short")
    for candidate in candidates[:3]:
        ask(app, candidate, reason=requests.AHEAD, trial_id=mine)
    ask(app, candidates[3], reason=requests.AHEAD, trial_id=others)
    with app.database.write() as db:
        assert requests.take_back(db, mine, keep=[candidates[1]], now=app.now()) == 2
    assert [status for status, *_ in statuses(app)] == ["cancelled", "asked", "cancelled", "asked"]


def test_what_another_trials_open_query_waits_for_is_not_taken_back(
    app: AppContext, candidates: list[int]
) -> None:
    mine, others = add_trial(app, "short"), add_trial(app, "short")
    rollout = ask(app, candidates[0], reason=requests.AHEAD, trial_id=mine)
    ask(app, candidates[0], trial_id=others)
    _wait_for(app, others, rollout, candidates[0])
    with app.database.write() as db:
        assert requests.take_back(db, mine, keep=[], now=app.now()) == 0
    assert statuses(app) == [("asked", "query", 0)]


def test_a_rollout_that_a_machine_has_claimed_is_not_taken_back(
    app: AppContext, candidates: list[int]
) -> None:
    mine = add_trial(app, "short")
    ask(app, candidates[0], trial_id=mine)
    with app.database.write() as db:
        db.scalars(select(Rollout)).one().status = "claimed"
    with app.database.write() as db:
        assert requests.take_back(db, mine, keep=[], now=app.now()) == 0


def test_a_candidate_taken_back_can_be_asked_for_again(
    app: AppContext, candidates: list[int]
) -> None:
    mine = add_trial(app, "short")
    first = ask(app, candidates[0], reason=requests.AHEAD, trial_id=mine)
    with app.database.write() as db:
        requests.take_back(db, mine, keep=[], now=app.now())
    second = ask(app, candidates[0], trial_id=mine)
    assert second != first
    with app.database.read() as db:
        assert list(db.scalars(select(Rollout.run_index).order_by(Rollout.id))) == [0, 1]


def test_sessions_that_ask_for_a_candidate_at_the_same_moment_get_one_rollout(
    app: AppContext, candidates: list[int]
) -> None:
    together = threading.Barrier(6)
    asked: list[str] = []

    def run() -> None:
        together.wait()
        asked.append(ask(app, candidates[0]))

    threads = [threading.Thread(target=run) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(asked) == 6
    assert len(set(asked)) == 1


def test_what_a_deleted_session_waited_for_is_not_run(
    app: AppContext, candidates: list[int]
) -> None:
    mine, others = add_trial(app, "short"), add_trial(app, "short")
    for candidate in candidates[:3]:
        ask(app, candidate, trial_id=mine)
    with app.database.read() as db:
        asked = db.scalars(select(Rollout.public_id).order_by(Rollout.id)).all()
    _wait_for(app, mine, asked[0], candidates[0])
    _wait_for(app, others, asked[1], candidates[1])
    with app.database.write() as db:
        person = db.get_one(Trial, mine).session.participant_id
        deletion.delete_person(app, db, person)
    assert [status for status, *_ in statuses(app)] == ["cancelled", "asked", "cancelled"]


def _wait_for(app: AppContext, trial_id: int, rollout: str, candidate_id: int) -> None:
    """An open query of this trial whose left video is not recorded yet."""
    with app.database.write() as db:
        db.add(
            QueryRow(
                public_id=f"q{trial_id}",
                trial_id=trial_id,
                query_index=0,
                trial_type="query",
                left_candidate=db.get_one(Candidate, candidate_id).candidate_index,
                right_candidate=0,
                left_rollout_id=db.scalars(
                    select(Rollout.id).where(Rollout.public_id == rollout)
                ).one(),
                acquisition="random",
                seed=1,
                engine_version="1",
                created_at=app.now(),
            )
        )
