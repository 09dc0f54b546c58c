"""Several people whose answers teach one model, at the same time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from fastapi import FastAPI
from sqlalchemy import select, update

from app.pbbo import PreferenceOptimizer
from app.pbbo import Settings as PbpoSettings
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.ethics.personal_data import Topic
from app.services.sessions import (
    lookup,
    queries,
    responses,
    shared_ahead,
    shared_replay,
    shared_trials,
    withdrawal,
)
from app.services.sessions.answers import Answer
from app.services.sessions.replay import Replayed, replay
from app.services.sessions.shared_trials import SharedAnswer, Sources
from app.storage.models.studies import Acquired, QueryRow, Response, Trial
from app.web.evaluator.privacy_sentences import SENTENCES
from tests.conftest import SHORT_PLAN, Clock, Idle, StudyShelf

from .client import Api, Session
from .test_at_once import at_once, respond
from .test_checks import table

TOGETHER = """\
conditions:
  - name: together
    method: pbpo-threshold
    environment: env1
    skip: {label: {en: I don't like either.}}
    settings: {threshold_covering: 2, threshold_length_scales: [0.3]}
    model: shared
trials_per_condition: 1
queries_per_trial: 4
break_s: 0
query: {undo_s: 30}
"""


def together(more: str = "") -> str:
    """The short study with one shared condition. more: further lines of the condition."""
    begin = SHORT_PLAN.partition("conditions:\n")[0]
    return begin + TOGETHER.replace("    model: shared\n", f"    model: shared\n{more}")


@pytest.fixture
def shared_study(app: AppContext, study_shelf: StudyShelf) -> None:
    study_shelf.put_into(app, together())


@pytest.fixture
def three(client: Api, shared_study: None) -> list[Session]:
    return [client.start().to_first_query() for _ in range(3)]


def open_pairs(app: AppContext) -> list[frozenset[int]]:
    """The pairs that wait for a response."""
    with app.database.read() as db:
        rows = db.execute(
            select(QueryRow.left_candidate, QueryRow.right_candidate)
            .outerjoin(Response, Response.query_id == QueryRow.id)
            .where(Response.id.is_(None))
        )
        return [frozenset(row) for row in rows]


def numbers(app: AppContext) -> list[int]:
    """From how many answers each query was proposed, in the order of queries."""
    with app.database.read() as db:
        rows = db.scalars(select(QueryRow).order_by(QueryRow.id))
        return [Sources.from_json(row.proposed_from or {}).number for row in rows]


def replayed(app: AppContext) -> list[Replayed]:
    found = list(replay(app, "short"))
    assert [trial.differences for trial in found] == [()] * len(found)
    return found


def test_everybodys_answers_teach_the_one_model_and_no_pair_is_with_two(
    app: AppContext, three: list[Session]
) -> None:
    assert len(set(open_pairs(app))) == 3
    for response in ("left", "right", "skip"):
        for session in three:
            assert session.respond(response).status_code == 200
            assert len(set(open_pairs(app))) == 3
    # Each was proposed from all answers there were.
    assert numbers(app) == [0, 0, 0, *range(1, 10)]
    for session in three:
        session.respond("left")
        assert session.state["stage"] == "debrief"
    assert [trial.gone for trial in replayed(app)] == [0, 0, 0]


def test_people_are_told_that_answers_are_shared_where_they_are(
    client: Api, shared_study: None
) -> None:
    said = client.get("/s/short/privacy").text
    assert SENTENCES[Topic.SHARED_MODEL] in said
    state = client.start().to_first_query().state
    assert set(state["query"]) == {"id", "left", "right", "skip", "prefetch"}


def test_who_deletes_everything_is_gone_from_the_model_at_once(
    app: AppContext, three: list[Session], api_token: str
) -> None:
    leaving, *others = three
    for session in three * 2:
        session.respond("left")
    withdrawal.withdraw_and_delete(app, leaving.token)
    for session in others:
        session.respond("right")
    # Of six answers two went; the next pairs came from the four that stayed, and those since.
    assert numbers(app)[-2:] == [5, 6]
    trials = replayed(app)
    # What had been proposed from the answers that went stays, and cannot be worked out again.
    assert len(trials) == 2
    assert all(trial.gone > 0 for trial in trials)
    assert len({answer.person for answer in everybodys_answers(app)}) == 2


def test_who_withdraws_teaches_no_more_and_all_can_still_be_worked_out(
    app: AppContext, three: list[Session]
) -> None:
    leaving, *others = three
    for session in three * 2:
        session.respond("left")
    assert leaving.call("withdraw").status_code == 200
    for session in others:
        session.respond("right")
    assert numbers(app)[-2:] == [5, 6]
    assert [trial.gone for trial in replayed(app)] == [0, 0, 0]


def test_an_answer_taken_back_no_longer_teaches_anybody(
    app: AppContext, three: list[Session]
) -> None:
    first, second, third = three
    first.respond("left")
    second.respond("left")
    assert (
        first.call("undo", {"query_id": first.state["query"]["undo"]["query_id"]}).status_code
        == 200
    )
    third.respond("left")
    assert numbers(app)[-1] == 2
    first.respond("right")
    assert numbers(app)[-1] == 3
    # The second person's pair and acquired candidate came from the answer that was taken back.
    assert sorted(trial.gone for trial in replayed(app)) == [0, 0, 2]


def test_people_who_answer_at_the_same_moment_get_different_pairs(
    app: AppContext, application: FastAPI, three: list[Session]
) -> None:
    for _ in range(3):
        answers = at_once(application, [respond(session, "left") for session in three])
        assert [answer.status_code for answer in answers] == [200] * 3
        for session in three:
            session.look()
        assert len(set(open_pairs(app))) == 3
    assert [trial.gone for trial in replayed(app)] == [0, 0, 0]


def test_servers_that_share_a_database_share_the_model(
    app: AppContext, three: list[Session], another_server: AppContext
) -> None:
    for _ in range(2):
        for server, session in zip((app, another_server, app), three, strict=True):
            query = session.look()["query"]["id"]
            responses.respond(server, session.token, Answer(query, "left"))
            assert len(set(open_pairs(app))) == 3
    assert numbers(app) == [0, 0, 0, *range(1, 7)]
    assert [trial.gone for trial in replayed(app)] == [0, 0, 0]


def test_a_step_that_was_computed_ahead_may_lack_what_others_said_since(
    app: AppContext, three: list[Session]
) -> None:
    ahead, other, _ = three
    prepare(app, ahead)
    shown = ahead.look()["query"]
    # Both videos of each pair that may come next, whatever the others say until then.
    assert shown["prefetch"]
    other.respond("right")
    ahead.respond("left")
    assert numbers(app)[-2:] == [1, 1]
    assert len(set(open_pairs(app))) == 3
    assert [trial.gone for trial in replayed(app)] == [0, 0, 0]


def test_a_step_computed_ahead_from_an_answer_that_is_gone_is_computed_again(
    app: AppContext, three: list[Session]
) -> None:
    ahead, other, _ = three
    other.respond("right")
    prepare(app, ahead)
    withdrawal.withdraw_and_delete(app, other.token)
    ahead.respond("left")
    assert numbers(app)[-1] == 1
    assert [trial.gone for trial in replayed(app)] == [0, 0]


def test_the_acquired_candidate_is_the_populations_or_each_persons(
    app: AppContext, client: Api, study_shelf: StudyShelf
) -> None:
    study_shelf.put_into(app, together("    for: person\n"))
    people = [client.start().to_first_query() for _ in range(2)]
    for _ in range(4):
        for session, wanted in zip(people, (max, min), strict=True):
            session.respond(side_of(app, session, wanted))
    with app.database.read() as db:
        rows = db.execute(
            select(Trial.session_id, Acquired.candidate)
            .join(Trial, Acquired.trial_id == Trial.id)
            .order_by(Acquired.query_index)
        )
        best = {row.session_id: row.candidate for row in rows}
    answers = everybodys_answers(app)
    first = answers[0].person
    optimizer = PreferenceOptimizer.replay(
        app.proposer.candidate_set(1, "env1").candidates,
        [(a.left, a.right, a.response, None, "01"[a.person != first]) for a in answers],
        method="pbpo-threshold",
        settings=PbpoSettings(threshold_covering=2, threshold_length_scales=(0.3,)),
    )
    # The last to answer knew all eight answers.
    assert best[2] == optimizer.best("1")
    assert optimizer.best("0") != optimizer.best("1")
    assert [trial.gone for trial in replayed(app)] == [0, 0]


@pytest.mark.parametrize("target", ["population", "person"])
def test_a_trial_ends_once_the_shared_model_is_sure(
    app: AppContext, client: Api, study_shelf: StudyShelf, target: str
) -> None:
    stop = "stop: {sure: 0.75, within: 0.4}\n"
    study_shelf.put_into(app, together(f"    for: {target}\n") + stop)
    people = [client.start().to_first_query() for _ in range(2)]
    assert people[0].state["progress"]["at_most"] is True
    for _ in range(4):
        for session in people:
            if session.state["stage"] == "query":
                session.respond(side_of(app, session, max))
    acquired, trials = table(app, "acquired"), table(app, "trials")
    for _, own in acquired.groupby("session_id"):
        *before, last = own["sureness"]
        assert last >= 0.75 > max(before, default=0.0)
    assert len(acquired) < 8
    assert trials["ended_at"].notna().all()
    answers = everybodys_answers(app)
    optimizer = PreferenceOptimizer.replay(
        app.proposer.candidate_set(1, "env1").candidates,
        [(a.left, a.right, a.response, None, str(a.person)) for a in answers],
        method="pbpo-threshold",
        seed=shared_trials._shared_seed(1, "together", "live"),
        settings=PbpoSettings(threshold_covering=2, threshold_length_scales=(0.3,)),
    )
    about = str(answers[-1].person) if target == "person" else None
    sure = optimizer.sureness(0.4, about)
    assert acquired["sureness"].iloc[-1] == pytest.approx(sure)
    assert [trial.gone for trial in replayed(app)] == [0, 0]
    # A trial that should have ended earlier is told.
    with app.database.write() as db:
        db.scalars(select(Trial)).first().ended_at = None  # type: ignore[union-attr]
    whats = [one.what for trial in replay(app, "short") for one in trial.differences]
    assert whats == ["trial ended early after query"]


def test_what_an_earlier_engine_proposed_is_not_compared_and_that_is_said(
    app: AppContext, three: list[Session]
) -> None:
    for session in three * 2:
        session.respond("left")
    before = sum(trial.queries for trial in replayed(app))
    with app.database.write() as db:
        # A pair that this engine would not propose.
        other = QueryRow.right_recording_id
        db.execute(update(QueryRow).values(engine_version="3", left_recording_id=other))
    found = replayed(app)
    assert [trial.earlier for trial in found] == [5, 5, 5]
    assert sum(trial.queries for trial in found) == before


# Helpers


@pytest.fixture
def another_server(app: AppContext, clock: Clock) -> Iterator[AppContext]:
    """Another process of the same installation, as far as memory goes."""
    server = open_app(app.settings, now=clock.now, background=Idle(1))
    yield server
    server.close()


def prepare(app: AppContext, session: Session) -> None:
    """What the background does while a pair plays."""
    with app.database.read() as db:
        row = lookup.find(app, db, session.token)
        query = queries.load_open_query(db, row, 0)
        spec = queries.trial_spec(row, 0, query.seed, query.asked.engine_version)
        trial = shared_trials.trial_of(row, 0, spec)
    assert trial is not None
    shared_ahead._work(app, trial, query)


def side_of(app: AppContext, session: Session, wanted: Callable[..., float]) -> str:
    """The side whose opening time is the larger, or the smaller."""
    with app.database.read() as db:
        row = db.scalars(
            select(QueryRow).where(QueryRow.public_id == session.state["query"]["id"])
        ).one()
    candidates = app.proposer.candidate_set(1, "env1").candidates
    sides = candidates[row.left_candidate][0], candidates[row.right_candidate][0]
    return ("left", "right")[sides.index(wanted(sides))]


def everybodys_answers(app: AppContext) -> tuple[SharedAnswer, ...]:
    with app.database.read() as db:
        trial = db.scalars(select(Trial)).first()
        assert trial is not None
        shared = shared_replay.trial_of(trial)
        assert shared is not None
        return shared_trials.read_answers(db, shared)
