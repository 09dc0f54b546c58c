"""Sessions over a search space: videos are recorded by a machine while people choose."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pytest
from sqlalchemy import Connection, event, select

from app.figures import svg
from app.pbbo import Box
from app.services.accounts import accounts
from app.services.background.interface import Background
from app.services.context import AppContext
from app.services.maintenance import retention
from app.services.proposals.computation import FitProcess
from app.services.results.charts import draw
from app.services.results.trial_learning import find
from app.services.rollouts import states
from app.services.runtime.ids import receipt_code
from app.services.sessions import box_withdrawal, withdrawal
from app.services.sessions.replay import replay
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import (
    Acquired,
    Candidate,
    Participant,
    PreferenceRow,
    QueryRow,
    Response,
    SessionRow,
)
from tests.conftest import Clock, Idle

from .client import Api, Session
from .desk import Desk
from .over_space import ScriptedMachine, open_live_study, to_first_pair, wait_for_pair
from .test_places import waiting
from .workers import until

T = TypeVar("T")
TRIANGLE = Box(low=[0, 0], high=[1, 1], constraints=["w0 >= w1"], names=["w0", "w1"])


class OneThread(Idle):
    """Work in the background in one thread, for whose end a test can wait."""

    def __init__(self) -> None:
        super().__init__(1)
        self._thread = ThreadPoolExecutor(1)

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        return self._thread.submit(function, *args)

    def finish(self) -> None:
        """Wait until all that was submitted is done."""
        self._thread.submit(int).result()

    def close(self) -> None:
        self._thread.shutdown(wait=True)
        super().close()


@pytest.fixture
def background() -> Background:
    return OneThread()


@pytest.fixture(autouse=True)
def _fits_here(monkeypatch: pytest.MonkeyPatch) -> None:
    def here(_self: FitProcess, compute: Callable[[Any], Any], requests: list[Any]) -> list[Any]:
        return [compute(request) for request in requests]

    monkeypatch.setattr(FitProcess, "map", here)


@pytest.fixture
def machine(app: AppContext, background: OneThread, tmp_path: Path) -> ScriptedMachine:
    return ScriptedMachine(app, tmp_path / "machine", background.finish)


def likes(person: Session, app: AppContext) -> str:
    """The response of somebody who likes long opening times."""
    left, right = pair(app, person)
    return "left" if left["w0"] >= right["w0"] else "right"


def pair(app: AppContext, person: Session) -> tuple[dict[str, float], dict[str, float]]:
    """The parameters of the pair on the screen."""
    with app.database.read() as db:
        query = db.scalars(
            select(QueryRow).where(QueryRow.public_id == person.state["query"]["id"])
        ).one()
        rows = db.scalars(
            select(Candidate).where(
                Candidate.candidate_index.in_((query.left_candidate, query.right_candidate))
            )
        )
        by_index = {row.candidate_index: row.parameters for row in rows}
        return by_index[query.left_candidate], by_index[query.right_candidate]


def answer(app: AppContext, person: Session, machine: ScriptedMachine, number: int) -> None:
    """Answer so many pairs."""
    for _ in range(number):
        wait_for_pair(person, machine)
        assert person.respond(likes(person, app)).status_code == 200


def differences(app: AppContext) -> list[Any]:
    return [one for trial in replay(app, "live") for one in trial.differences]


def test_a_session_runs_to_its_end_over_videos_that_did_not_exist(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study")
    person = client.start("live")
    person.consent()
    while person.state["stage"] != "query":
        person.go_on()
    waiting = person.state["waiting"]
    assert person.state["query"] is None
    assert waiting["left"] is None
    assert waiting["machines"] == 0

    machine.run(1)
    half = person.look()["waiting"]
    assert (half["left"] is None) != (half["right"] is None)
    video = (half["left"] or half["right"])["url"]
    assert client.get(video).status_code == 200
    machine.run(1)
    assert person.look()["query"]["left"]["url"]

    answer(app, person, machine, 6)
    assert person.state["stage"] == "debrief"
    assert differences(app) == []
    with app.database.read() as db:
        rows = db.scalars(select(QueryRow).order_by(QueryRow.query_index)).all()
        assert len(rows) == 6
        points = {row.candidate_index: row.parameters for row in db.scalars(select(Candidate))}
        assert all(one["w0"] >= one["w1"] for one in points.values())
        seen: set[int] = set()
        for row in rows:
            new = {row.left_candidate, row.right_candidate} - seen
            assert len(new) <= (2 if row.query_index == 0 else 1)
            seen |= new
        acquired = db.scalars(select(Acquired).order_by(Acquired.query_index)).all()
        assert [one.query_index for one in acquired] == list(range(6))
        assert all(one.candidate in points for one in acquired)
        assert db.scalars(select(PreferenceRow.query_index)).all() == list(range(6))


def test_a_trial_over_a_space_ends_once_it_is_sure_and_its_belief_is_drawn(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    stop = "stop: {sure: 0.75, within: 0.3}\n"
    study = open_live_study(app, tmp_path / "study", more=stop, queries=30)
    person = to_first_pair(client, machine)
    while person.state["stage"] == "query":
        answer(app, person, machine, 1)
    assert differences(app) == []
    assert machine.asked() == []
    with app.database.read() as db:
        rows = db.scalars(select(Acquired).order_by(Acquired.query_index)).all()
        session_id = db.scalars(select(SessionRow.public_id)).one()
        answered = len(db.scalars(select(QueryRow.id)).all())
    *before, last = [row.sureness or 0.0 for row in rows]
    assert last >= 0.75 > max(before)
    assert answered == len(rows) < 30

    path = find(app, study, session_id, 0, "path")
    assert [row["sureness"] for row in path.rows] == [row.sureness for row in rows]
    belief = find(app, study, session_id, 0, "posterior")
    assert f"{last:.0%}".replace("%", " %") in belief.says
    ground = [row for row in belief.rows if row["candidate"] is None]
    assert len(ground) > 200
    assert all(row["w0"] >= row["w1"] for row in ground)
    known = [row for row in belief.rows if row["candidate"] is not None]
    assert sum(row["times_shown"] for row in known) == 2 * answered
    [best] = [row for row in known if row["candidate"] == rows[-1].candidate]
    assert best["posterior_mean"] == pytest.approx(rows[-1].posterior_mean)
    assert max(row["posterior_mean"] for row in ground) <= best["posterior_mean"] + 1e-6
    for name, found in (("path", path), ("posterior", belief)):
        assert svg(draw(name, found, study)).startswith("<svg")


def test_a_pair_that_is_not_recorded_cannot_be_answered(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study", rollout="{ahead: 0}")
    person = to_first_pair(client, machine)
    assert person.respond("left").status_code == 200
    assert person.state["query"] is None
    with app.database.read() as db:
        waits = db.scalars(select(QueryRow.public_id).where(QueryRow.query_index == 1)).one()

    refused = person.call("responses", {"query_id": waits, "response": "left"})

    assert refused.status_code == 409
    assert refused.json()["type"].endswith("not-recorded-yet")
    assert person.look()["stage"] == "query"


@pytest.mark.parametrize("becomes", ["unsafe", "failed"])
def test_a_pair_whose_recording_is_lost_is_proposed_anew(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path, becomes: str
) -> None:
    open_live_study(app, tmp_path / "study", rollout="{attempts: 1}")
    person = to_first_pair(client, machine)
    lost: list[dict[str, float]] = []

    def first_is_lost(parameters: dict[str, float]) -> str:
        if not lost:
            lost.append(parameters)
        return becomes if parameters == lost[0] else "recorded"

    answer(app, person, machine, 2)
    person.look()
    machine.run(becomes=first_is_lost)
    shown: list[dict[str, float]] = []
    for _ in range(4):
        wait_for_pair(person, machine)
        shown += pair(app, person)
        person.respond(likes(person, app))
    assert lost
    assert lost[0] not in shown
    assert person.state["stage"] == "debrief"
    assert differences(app) == []


def test_what_is_unsafe_is_not_proposed_to_anybody_from_then_on(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study")
    first = client.start("live")
    first.consent()
    while first.state["stage"] != "query":
        first.go_on()
    machine.run(1, becomes=lambda _: "unsafe")
    wait_for_pair(first, machine)
    answer(app, first, machine, 6)
    second = to_first_pair(client, machine)
    answer(app, second, machine, 6)

    with app.database.read() as db:
        bad = db.scalars(
            select(Candidate.candidate_index)
            .join(Rollout, Rollout.candidate_id == Candidate.id)
            .where(Rollout.status == states.UNSAFE)
        ).one()
        later = db.scalars(select(QueryRow).where(QueryRow.set_aside_at.is_(None))).all()
        assert all(bad in (row.proposed_from or {})["excluded"] for row in later)
        assert all(bad not in (row.left_candidate, row.right_candidate) for row in later)
    assert differences(app) == []


@pytest.mark.parametrize("lag", [0, 1])
def test_machines_are_asked_ahead_and_taken_back_from(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path, lag: int
) -> None:
    open_live_study(app, tmp_path / "study", rollout=f"{{ahead: 3, lag: {lag}}}", queries=8)
    person = to_first_pair(client, machine)
    for _ in range(5):
        wait_for_pair(person, machine)
        ahead = [one for one in machine.asked() if one.reason == "ahead"]
        assert len(ahead) <= (3 if lag == 0 else 1)
        machine.run()
        person.look()
        assert person.respond(likes(person, app)).status_code == 200
        assert person.state["query"] is not None, "the pair was recorded while the last one played"
    assert differences(app) == []
    person.call("withdraw")
    assert machine.asked() == []


def test_work_that_begins_after_a_withdrawal_asks_machines_for_nothing(
    client: Api,
    app: AppContext,
    machine: ScriptedMachine,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    open_live_study(app, tmp_path / "study", rollout="{ahead: 3}")
    person = to_first_pair(client, machine)
    put_off: list[Callable[[], None]] = []
    monkeypatch.setattr(
        app.background, "in_thread", lambda key, work, *args: put_off.append(partial(work, *args))
    )
    assert person.respond(likes(person, app)).status_code == 200
    wait_for_pair(person, machine)
    person.call("withdraw")
    assert put_off
    for work in put_off:
        work()
    assert machine.asked() == []


LEAVING: dict[str, Callable[[AppContext, Session], object]] = {
    "withdraws": lambda _, person: person.call("withdraw"),
    "is deleted": lambda app, _: withdrawal.delete_participant(
        app, "live", pseudonym(app), "ada@lab.example"
    ),
    "loses a recording": lambda app, _: withdraw_shown_at(app, 0),
}


@pytest.mark.postgresql
@pytest.mark.parametrize("how", LEAVING)
def test_work_in_the_moment_of_a_withdrawal_asks_machines_for_nothing_in_vain(
    client: Api,
    app: AppContext,
    machine: ScriptedMachine,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    how: str,
) -> None:
    open_live_study(app, tmp_path / "study", rollout="{ahead: 3}")
    person = to_first_pair(client, machine)
    put_off: list[Callable[[], None]] = []
    monkeypatch.setattr(
        app.background, "in_thread", lambda key, work, *args: put_off.append(partial(work, *args))
    )
    assert person.respond(likes(person, app)).status_code == 200
    wait_for_pair(person, machine)
    work, before = put_off[-1], cancelled(app)
    begun: list[Future[None]] = []

    def work_before_the_commit(_: Connection) -> None:
        if not begun:
            begun.append(threads.submit(work))
            until(lambda: begun[0].done() or waiting(app) == 1, "the work ends, or waits for it")

    with ThreadPoolExecutor(1) as threads:
        event.listen(app.database.engine, "commit", work_before_the_commit)
        LEAVING[how](app, person)
        begun[0].result()
    event.remove(app.database.engine, "commit", work_before_the_commit)
    if how == "loses a recording":
        put_off.clear()
        person.look()
        for again in put_off:
            again()
        assert machine.asked()
    else:
        assert machine.asked() == []
    assert cancelled(app) == before


def cancelled(app: AppContext) -> int:
    """How many rollouts were taken back."""
    with app.database.read() as db:
        return db.query(Rollout).filter_by(status=states.CANCELLED).count()


def test_with_lag_a_pair_does_not_depend_on_the_last_response(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study", rollout="{lag: 1}")
    person = to_first_pair(client, machine)
    answer(app, person, machine, 6)
    with app.database.read() as db:
        sources = db.scalars(select(QueryRow.proposed_from).order_by(QueryRow.query_index)).all()
        pairs = db.execute(
            select(QueryRow.left_candidate, QueryRow.right_candidate).order_by(QueryRow.query_index)
        ).all()
    for place, one in enumerate(sources):
        assert one["answered"] == list(range(place - 1))
        assert one["pending"] == ([list(pairs[place - 1])] if place else [])
    assert differences(app) == []


def test_responses_to_withdrawn_recordings_leave_the_model_and_stay_in_the_record(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study")
    person = to_first_pair(client, machine)
    answer(app, person, machine, 2)
    gone = withdraw_shown_at(app, 1)
    assert 1 in gone
    assert differences(app) == []
    answer(app, person, machine, 4)
    assert person.state["stage"] == "debrief"
    with app.database.read() as db:
        learnt = db.scalars(select(PreferenceRow.query_index)).all()
        last = db.scalars(select(QueryRow).where(QueryRow.query_index == 5)).one()
    assert not gone & set(learnt)
    assert not gone & set((last.proposed_from or {})["answered"])
    assert differences(app) == []

    # The trial has ended: what follows from the others is derived anew all the same.
    more = withdraw_shown_at(app, 5) - gone
    assert more
    with app.database.read() as db:
        rows = db.scalars(select(PreferenceRow).order_by(PreferenceRow.preference_index)).all()
        acquired = db.scalars(select(Acquired).order_by(Acquired.query_index)).all()
        assert db.query(Response).count() == 6
    left = sorted({0, 1, 2, 3, 4, 5} - gone - more)
    assert [row.query_index for row in rows] == left
    assert [row.preference_index for row in rows] == list(range(len(left)))
    assert not left or (acquired[-1].computed_from or {})["answered"] == left
    assert differences(app) == []
    for place in left:
        withdraw_shown_at(app, place)
    with app.database.read() as db:
        assert db.query(PreferenceRow).count() == db.query(Acquired).count() == 0
    assert differences(app) == []


def test_a_response_to_a_recording_that_was_withdrawn_meanwhile_teaches_nothing(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study", queries=2)
    person = to_first_pair(client, machine)
    withdraw_shown_at(app, 0)
    assert person.respond("left").status_code == 200
    answer(app, person, machine, 1)
    with app.database.read() as db:
        assert db.scalars(select(PreferenceRow.query_index)).all() == [1]
        assert db.query(Response).count() == 2
    assert differences(app) == []


def withdraw_shown_at(app: AppContext, place: int) -> set[int]:
    """Withdraw the left recording of this query if it is not yet; all queries withdrawn so far."""
    with app.database.read() as db:
        row = db.scalars(
            select(QueryRow).where(QueryRow.query_index == place, QueryRow.set_aside_at.is_(None))
        ).one()
        rollout = db.get_one(Rollout, row.left_rollout_id)
    if rollout.status != states.WITHDRAWN:
        box_withdrawal.withdraw(app, "live", rollout.public_id, "the camera had moved")
    with app.database.read() as db:
        gone = select(QueryRow.query_index).where(QueryRow.withdrawn_at.is_not(None))
        return set(db.scalars(gone))


DELETIONS: dict[str, Callable[[AppContext, Session], object]] = {
    "receipt": lambda app, person: withdrawal.delete_by_receipt(
        app, "live", receipt_code(person.token)
    ),
    "pseudonym": lambda app, _: withdrawal.delete_participant(
        app, "live", pseudonym(app), "ada@lab.example"
    ),
    "retention": lambda app, _: retention.delete_due(app, lambda: False),
}


@pytest.mark.parametrize("how", DELETIONS)
def test_nothing_is_recorded_for_somebody_whose_data_is_deleted(
    client: Api,
    app: AppContext,
    machine: ScriptedMachine,
    clock: Clock,
    tmp_path: Path,
    how: str,
) -> None:
    open_live_study(app, tmp_path / "study", more="retention: {everything_days: 1}\n")
    person = to_first_pair(client, machine)
    person.respond("left")
    person.look()
    assert machine.asked()
    clock.forward(60 * 86_400)
    DELETIONS[how](app, person)
    assert machine.asked() == []


def pseudonym(app: AppContext) -> str:
    with app.database.read() as db:
        return db.scalars(select(Participant.pseudonym)).one()


def test_a_response_is_undone_and_the_machine_is_asked_for_what_is_needed_then(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study", more="query: {undo_s: 10}\n")
    person = to_first_pair(client, machine)
    before = person.state["query"]["id"]
    person.respond("left")
    assert person.call("undo", {"query_id": before}).status_code == 200
    assert person.state["query"]["id"] == before
    answer(app, person, machine, 6)
    assert person.state["stage"] == "debrief"
    assert differences(app) == []


def test_a_video_that_does_not_play_is_replaced(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study", more="checks: {repeats: 0.3}\n")
    person = to_first_pair(client, machine)
    for number in range(8):
        wait_for_pair(person, machine)
        if number in (0, 4):
            fault = {"query_id": person.state["query"]["id"], "reason": "decode"}
            assert person.call("faults", fault).status_code == 200
            wait_for_pair(person, machine)
        assert person.respond(likes(person, app)).status_code == 200
    assert person.state["stage"] == "debrief"
    assert differences(app) == []


def test_without_reuse_every_pair_is_run_anew(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    open_live_study(app, tmp_path / "study", rollout="{reuse: false, ahead: 0}")
    person = to_first_pair(client, machine)
    answer(app, person, machine, 6)
    with app.database.read() as db:
        rows = db.scalars(select(QueryRow)).all()
        shown = [one for row in rows for one in (row.left_rollout_id, row.right_rollout_id)]
    assert len(set(shown)) == len(shown) == 12


def test_what_a_trial_acquired_is_recorded_by_one_press_and_shown_beside_its_first_pair(
    client: Api, app: AppContext, machine: ScriptedMachine, tmp_path: Path
) -> None:
    study = open_live_study(app, tmp_path / "study", rollout="{ahead: 0}", queries=2)
    person = to_first_pair(client, machine)
    answer(app, person, machine, 2)
    with app.database.write() as db:
        # Whatever the model says: a candidate that was in no pair.
        last = db.scalars(select(Acquired).order_by(Acquired.query_index.desc())).first()
        assert last is not None
        following = 1 + max(db.scalars(select(Candidate.candidate_index)))
        last.candidate = following
        db.add(
            Candidate(
                study_id=study.id,
                environment=study.plan.used_environments[0],
                candidate_index=following,
                parameters={"w0": 0.875, "w1": 0.125},
                point_key="0.875,0.125",
            )
        )
        public_id = db.scalars(select(SessionRow.public_id)).one()
    lab = Desk(client, app, "lab@example.org", accounts.Role.ADMIN)
    assert "It has no video yet" in lab.get(f"/studies/live/sessions/{public_id}").text
    assert "1 candidate that a trial has acquired" in lab.get("/studies/live/machines").text

    assert lab.post("/studies/live/machines/results").status_code == 303
    assert [one.reason for one in machine.asked()] == ["acquired"]
    assert "Results without a video" not in lab.get("/studies/live/machines").text
    machine.run()
    assert machine.seen[-1] == {"w0": 0.875, "w1": 0.125}
    page = lab.get(f"/studies/live/sessions/{public_id}").text
    assert f"recording 1 of the acquired candidate, candidate {following}" in page
    lab.post("/studies/live/machines/results")
    assert machine.asked() == []
