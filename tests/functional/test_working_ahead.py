"""What the server does while an evaluator watches, so that a response costs no wait."""

from __future__ import annotations

import re

import pytest

from app.services.background.interface import Background
from app.services.context import AppContext
from app.services.monitoring import health
from app.services.studies.repository import StudyInfo
from tests.conftest import NoRendering, StudyShelf

from .client import Api, Session
from .test_shared_models import together


@pytest.fixture
def background() -> Background:
    return NoRendering(1)


def prefetch(app: AppContext, session: Session) -> list[str]:
    """The addresses to load ahead, once all possible responses have been worked out."""
    app.background.in_thread("after all that", lambda: None).result(timeout=60)
    return list(session.look()["query"]["prefetch"])


def steps_asked(app: AppContext) -> dict[str, str]:
    """How many steps had been worked out ahead, and how many when they were asked for."""
    said = health.metrics(app).decode()
    return dict(re.findall(r'pbpo_steps_asked_total\{worked_out="(.*?)"\} (.*)', said))


@pytest.mark.parametrize("response", ["left", "right"])
def test_the_videos_of_the_next_query_are_named_before_the_response(
    client: Api, app: AppContext, learning_study: StudyInfo, response: str
) -> None:
    session = client.start().to_first_query()
    for _ in range(4):
        urls = prefetch(app, session)
        session.respond(response)
        query = session.state["query"]
        assert {query["left"]["url"], query["right"]["url"]} <= set(urls)


def test_a_query_that_the_model_chooses_depends_on_the_response(
    client: Api, app: AppContext, learning_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    assert len(prefetch(app, session)) == 2
    named = []
    for _ in range(3):
        session.respond("left")
        named.append(len(prefetch(app, session)))
    assert max(named) > 2


def test_no_response_of_a_trial_waits_for_a_fit(
    client: Api, app: AppContext, learning_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    while session.state["stage"] == "query":
        prefetch(app, session)
        session.respond("left")
    assert steps_asked(app) == {"ahead": "5.0", "at once": "0.0"}


def test_no_pair_of_a_shared_model_waits_for_a_fit_nor_does_the_first(
    client: Api, app: AppContext, study_shelf: StudyShelf
) -> None:
    study_shelf.put_into(app, together())
    for _ in range(2):
        session = client.start()
        while session.state["stage"] != "query":
            session.step("left", lambda _: None)
            app.background.in_thread("after all that", lambda: None).result(timeout=60)
        while session.state["stage"] == "query":
            prefetch(app, session)
            session.respond("left")
    # Of each person: the first pair, and what follows each of four answers.
    assert steps_asked(app) == {"ahead": "10.0", "at once": "0.0"}


def test_nothing_is_loaded_ahead_of_the_last_query(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    for _ in range(3):
        session.respond("left")
    assert prefetch(app, session) == []
