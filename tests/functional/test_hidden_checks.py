"""The list of videos to prefetch does not tell an evaluator which queries are checks."""

from __future__ import annotations

import pytest

from app.services.background.interface import Background
from app.services.context import AppContext
from tests.conftest import Clock, NoRendering, StudyShelf

from .client import Api
from .test_checks import CHECKED_PLAN, one_condition
from .test_working_ahead import prefetch

#: Queries after which the trial has shown enough videos to fill every list.
ENOUGH = 3


@pytest.fixture
def background() -> Background:
    return NoRendering(1)


@pytest.mark.parametrize("in_model", ["false", "true"])
def test_as_many_videos_are_named_ahead_of_checks_as_of_other_queries(
    client: Api, app: AppContext, study_shelf: StudyShelf, clock: Clock, in_model: str
) -> None:
    plan = CHECKED_PLAN.replace("attention: 0.2", f"attention: 0.2, in_model: {in_model}")
    study_shelf.put_into(app, one_condition(plan))
    session = client.start().to_stage("query", clock.forward)
    named = []
    while session.state["stage"] == "query":
        urls = prefetch(app, session)
        assert urls == prefetch(app, session), "a second look would tell which ones are real"
        named.append(len(urls))
        session.respond("left")
        if session.state["stage"] == "query":
            query = session.state["query"]
            assert {query["left"]["url"], query["right"]["url"]} <= set(urls)
    assert set(named[ENOUGH:-1]) == {6}
