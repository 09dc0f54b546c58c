"""A session that goes on elsewhere while what follows a response is worked out."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from app.services import answers, replay, undoing, withdrawal
from app.services.answers import FaultReport
from app.services.proposals import Step, TrialInHand
from app.services.studio import Studio
from app.services.thoughts import History
from app.storage.tables import Response
from tests.conftest import StudyShelf

from .client import Api, Session
from .conftest import LEARNING_PLAN
from .test_crowding import rows

Elsewhere = Callable[[Callable[[], object]], None]


@pytest.fixture
def person(client: Api, studio: Studio, study_shelf: StudyShelf) -> Session:
    """Somebody at the third pair, who may take the second answer back."""
    study_shelf.put_into(studio, LEARNING_PLAN + "query: {undo_s: 5}\n")
    session = client.start().to_first_query()
    for response in ("left", "right"):
        assert session.respond(response).status_code == 200
    return session


@pytest.fixture
def elsewhere(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> Elsewhere:
    """Has something done, once, while the next step is worked out."""

    def done_meanwhile(happens: Callable[[], object]) -> None:
        real, left = studio.proposer.step, [happens]

        def step(trial: TrialInHand, history: History) -> Step:
            while left:
                left.pop()()
            return real(trial, history)

        monkeypatch.setattr(studio.proposer, "step", step)

    return done_meanwhile


def follows_from_its_history(studio: Studio) -> bool:
    return not any(trial.differences for trial in replay.replay(studio, "short"))


def test_a_pair_that_is_set_aside_meanwhile_takes_no_response(
    studio: Studio, person: Session, elsewhere: Elsewhere
) -> None:
    report = FaultReport(person.state["query"]["id"], "pressed")
    elsewhere(lambda: answers.report_fault(studio, person.token, report))
    assert person.respond("left").status_code == 409
    assert rows(studio, Response) == 2
    person.look()
    assert person.respond("left").status_code == 200
    assert follows_from_its_history(studio)


def test_an_answer_that_is_taken_back_meanwhile_leads_back_to_its_pair(
    studio: Studio, person: Session, elsewhere: Elsewhere
) -> None:
    before = person.state["query"]["undo"]["query_id"]
    elsewhere(lambda: undoing.undo(studio, person.token, before))
    assert person.respond("left").status_code == 404
    assert person.look()["query"]["id"] == before
    for _ in range(2):
        assert person.respond("left").status_code == 200
    assert rows(studio, Response) == 3
    assert follows_from_its_history(studio)


def test_who_is_deleted_meanwhile_leaves_nothing(
    studio: Studio, person: Session, elsewhere: Elsewhere
) -> None:
    elsewhere(lambda: withdrawal.withdraw_and_delete(studio, person.token))
    assert person.respond("left").status_code == 401
    assert rows(studio, Response) == 0
    assert studio.proposer.cached_seeds() == frozenset()
