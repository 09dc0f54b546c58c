"""Links whose parameters nobody filled in: whoever comes by one is a newcomer."""

from __future__ import annotations

import html
import re

import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext

from .client import Api
from .conftest import Recruit
from .desk import Desk
from .test_participant_pages import HEADINGS, agree, heading, sent_on, token_for
from .test_recruitment import PROLIFIC, SONA, identities
from .test_returning import in_another_browser, sessions_and_people

UNFILLED = {
    PROLIFIC: "PROLIFIC_PID={{%PROLIFIC_PID%}}&STUDY_ID={{%STUDY_ID%}}&SESSION_ID={{%SESSION_ID%}}",
    SONA: "id=%SURVEY_CODE%",
}


@pytest.mark.parametrize("returning", ["resume", "block", "again"])
@pytest.mark.parametrize("plan", UNFILLED)
def test_two_who_come_by_the_same_unfilled_link_are_two(
    client: Api, recruit: Recruit, app: AppContext, plan: str, returning: str
) -> None:
    recruit(f"{plan}  returning: {returning}\n")
    for _ in range(2):
        link = f"?{UNFILLED[plan]}"
        assert heading(client.get(f"/s/short{link}")) == HEADINGS["consent"]
        sent_on(agree(client, link))
        in_another_browser(client)
    assert sessions_and_people(app) == (2, 2)
    assert identities(client, token_for(app)) == {}


def test_the_link_that_the_recruit_page_gives_is_safe_to_open_as_it_stands(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(f"{PROLIFIC}  returning: block\n")
    desk = Desk(client, app, "ada@lab.example", Role.ADMIN)
    page = desk.get("/studies/short/recruit").text
    found = re.search(r">http://testserver(/s/short\?PROLIFIC_PID=[^<]+)<", page)
    assert found
    for _ in range(2):
        link = html.unescape(found[1])
        in_another_browser(client)
        assert heading(client.get(link)) == HEADINGS["consent"]
        sent_on(agree(client, link.removeprefix("/s/short")))
    assert sessions_and_people(app) == (2, 2)


def test_the_overview_tells_of_people_who_came_by_such_links_and_of_links_that_were_refused(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(PROLIFIC)
    desk = Desk(client, app, "ada@lab.example", Role.ADMIN)
    assert "not filled in" not in desk.get("/studies/short").text
    agree(client, f"?{UNFILLED[PROLIFIC]}")
    client.start(external_ids={"PROLIFIC_PID": "undefined"})
    client.get("/s/short?PROLIFIC_PID=a&PROLIFIC_PID=b")
    page = html.unescape(desk.get("/studies/short").text)
    assert "2 participants came by a link in which the platform's parameters were not" in page
    assert "One request was refused because a parameter of the platform came twice" in page


def test_a_program_is_told_of_an_id_that_cannot_be_read(client: Api, recruit: Recruit) -> None:
    recruit(PROLIFIC)
    body = {"external_ids": {"PROLIFIC_PID": "a", "prolific_pid": "b"}}
    answer = client.post("/api/v1/studies/short/sessions", json=body)
    assert answer.status_code == 422
    assert answer.json()["type"] == "urn:pbpo-studio:problem:ids-refused"
    assert "expected one value, got two that differ" in answer.json()["detail"]
