"""Trials that end once they are sure: stored, shown honestly, exported, and replayed."""

from __future__ import annotations

import pytest
from sqlalchemy import select

from app.pbbo import PreferenceOptimizer, Settings
from app.services.context import AppContext
from app.services.sessions.replay import replay
from app.services.studies import repository
from app.storage.models.studies import Trial
from tests.conftest import Clock, StudyShelf

from .client import Api, Session, by_turns
from .test_checks import CHECKED_PLAN as PLAN
from .test_checks import one_condition, rows, table
from .test_participant_pages import COOKIE

#: Sure of being within half of the range: so after a few answers, and not after the first.
STOP = "stop: {sure: 0.9, within: 0.5}\n"


@pytest.fixture
def stopped(app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock) -> Session:
    """An evaluator whose only trial may end early, at its end."""
    study_shelf.put_into(app, one_condition(PLAN) + STOP)
    session = client.start().to_first_query()
    assert session.state["progress"]["at_most"] is True
    session.to_the_end(by_turns("left", "right", "left"), clock.forward)
    return session


def test_a_trial_ends_after_the_first_answer_by_which_it_is_sure(
    stopped: Session, app: AppContext
) -> None:
    assert stopped.state["stage"] == "completed"
    acquired, queries = table(app, "acquired"), table(app, "queries")
    *before, last = acquired["sureness"]
    assert last >= 0.9 > max(before)
    assert len(queries) < stopped.state["progress"]["queries"] == 15
    assert queries["response"].notna().all()
    assert table(app, "trials")["ended_at"].notna().all()
    assert table(app, "trials")["sureness"].to_list() == [last]
    assert [one.differences for one in replay(app, "short")] == [()]


def test_what_is_exported_is_what_the_optimiser_says_of_the_answers(
    stopped: Session, app: AppContext
) -> None:
    study = repository.find(app, "short")
    space = app.proposer.candidate_set(study.id, "env1")
    asked = [one for one in rows(table(app, "queries")) if one["trial_type"] in ("random", "model")]
    optimizer = PreferenceOptimizer.replay(
        space.candidates,
        [(one["left_candidate"], one["right_candidate"], one["response"]) for one in asked],
        method="pbpo",
        seed=asked[0]["seed"],
        settings=Settings.from_mapping(study.plan.conditions[0].settings),
    )
    assert table(app, "acquired")["sureness"].iloc[-1] == pytest.approx(optimizer.sureness(0.5))


def test_a_replay_tells_a_trial_that_ended_where_it_should_not(
    stopped: Session, app: AppContext
) -> None:
    with app.database.write() as db:
        db.scalars(select(Trial).where(Trial.trial_index >= 0)).one().ended_at = None
    [found] = [one.differences for one in replay(app, "short")]
    ended = len(table(app, "queries")) - 1
    assert [(one.what, one.stored, one.worked_out) for one in found] == [
        ("trial ended early after query", (None,), (ended,))
    ]


def test_the_page_says_that_the_number_of_pairs_is_the_most(
    app: AppContext, study_shelf: StudyShelf, client: Api
) -> None:
    study_shelf.put_into(app, one_condition(PLAN) + STOP)
    person = client.start().to_first_query()
    client.cookies.set(COOKIE, person.token)
    page = client.get("/s/short")
    assert "Pair 1 of at most 15" in page.text
