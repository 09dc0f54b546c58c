"""A session that goes on elsewhere while what follows a response is worked out."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from app.services.context import AppContext
from app.services.proposals.computation import History
from app.services.proposals.proposer import NextStep, TrialSpec
from app.services.sessions import replay, undo, video_faults, withdrawal
from app.services.sessions.video_faults import FaultReport
from app.storage.models.studies import Response
from tests.conftest import StudyShelf

from .client import Api, Session
from .conftest import LEARNING_PLAN
from .test_crowding import rows

FitProcess = Callable[[Callable[[], object]], None]


@pytest.fixture
def person(client: Api, app: AppContext, study_shelf: StudyShelf) -> Session:
    """Somebody at the third pair, who may take the second answer back."""
    study_shelf.put_into(app, LEARNING_PLAN + "query: {undo_s: 5}\n")
    session = client.start().to_first_query()
    for response in ("left", "right"):
        assert session.respond(response).status_code == 200
    return session


@pytest.fixture
def elsewhere(app: AppContext, monkeypatch: pytest.MonkeyPatch) -> FitProcess:
    """Has something done, once, while the next step is worked out."""

    def done_meanwhile(happens: Callable[[], object]) -> None:
        real, left = app.proposer.step, [happens]

        def step(trial: TrialSpec, history: History) -> NextStep:
            while left:
                left.pop()()
            return real(trial, history)

        monkeypatch.setattr(app.proposer, "step", step)

    return done_meanwhile


def follows_from_its_history(app: AppContext) -> bool:
    return not any(trial.differences for trial in replay.replay(app, "short"))


def test_a_pair_that_is_set_aside_meanwhile_takes_no_response(
    app: AppContext, person: Session, elsewhere: FitProcess
) -> None:
    report = FaultReport(person.state["query"]["id"], "pressed")
    elsewhere(lambda: video_faults.report_fault(app, person.token, report))
    assert person.respond("left").status_code == 409
    assert rows(app, Response) == 2
    person.look()
    assert person.respond("left").status_code == 200
    assert follows_from_its_history(app)


def test_an_answer_that_is_taken_back_meanwhile_leads_back_to_its_pair(
    app: AppContext, person: Session, elsewhere: FitProcess
) -> None:
    before = person.state["query"]["undo"]["query_id"]
    elsewhere(lambda: undo.undo(app, person.token, before))
    assert person.respond("left").status_code == 404
    assert person.look()["query"]["id"] == before
    for _ in range(2):
        assert person.respond("left").status_code == 200
    assert rows(app, Response) == 3
    assert follows_from_its_history(app)


def test_who_is_deleted_meanwhile_leaves_nothing(
    app: AppContext, person: Session, elsewhere: FitProcess
) -> None:
    elsewhere(lambda: withdrawal.withdraw_and_delete(app, person.token))
    assert person.respond("left").status_code == 401
    assert rows(app, Response) == 0
    assert app.proposer.cached_seeds() == frozenset()
