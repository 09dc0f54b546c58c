"""An answer by the page's own form: what a browser sends where the page's scripts have failed."""

from __future__ import annotations

import re

import pytest

from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api
from .test_participant_pages import in_browser, sent_on


def form(client: Api) -> tuple[str, str]:
    """Where the form of the query page is sent, and the pair it answers."""
    page = client.get("/s/short").text
    action = re.search(r'<form class="pair"[^>]* action="([^"]+)"', page)
    query_id = re.search(r'name="query_id" value="([^"]+)"', page)
    assert action is not None
    assert query_id is not None
    return action[1], query_id[1]


def test_the_form_stores_an_answer_and_leads_to_the_next_pair(
    client: Api, short_study: StudyInfo, api_token: str, clock: Clock
) -> None:
    in_browser(client, "query", clock)
    action, query_id = form(client)
    given = {"query_id": query_id, "response": "left", "rt_ms": "1234"}
    sent_on(client.post(action, data=given))
    assert form(client)[1] != query_id
    stored = client.table("queries", api_token)
    assert stored["response"].to_list()[0] == "left"
    assert stored["rt"].to_list()[0] == 1234
    assert "sent_by_form" in client.table("events", api_token)["event"].to_list()


def test_the_form_sent_twice_or_too_late_changes_nothing_and_leads_to_the_open_pair(
    client: Api, short_study: StudyInfo, api_token: str, clock: Clock
) -> None:
    in_browser(client, "query", clock)
    action, query_id = form(client)
    for response in ("right", "right", "left"):
        sent_on(client.post(action, data={"query_id": query_id, "response": response, "rt_ms": ""}))
    stored = client.table("queries", api_token)["response"].fillna("").to_list()
    assert stored == ["right", ""]


@pytest.mark.parametrize(
    "wrong",
    [{"response": "both"}, {"rt_ms": "-1"}, {"rt_ms": "soon"}, {"rt_ms": "nan"}, {"query_id": ""}],
)
def test_a_form_that_no_page_sends_is_refused_and_stores_nothing(
    client: Api, short_study: StudyInfo, api_token: str, clock: Clock, wrong: dict[str, str]
) -> None:
    in_browser(client, "query", clock)
    action, query_id = form(client)
    given = {"query_id": query_id, "response": "left", "rt_ms": "900", **wrong}
    assert client.post(action, data=given).status_code == 422
    assert client.table("queries", api_token)["response"].isna().all()


def test_without_a_session_the_form_leads_to_the_first_page(
    client: Api, short_study: StudyInfo
) -> None:
    sent_on(client.post("/s/short/respond", data={"query_id": "x", "response": "left"}))
