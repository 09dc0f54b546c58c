"""The page that brings people in: links, codes, places, and which conditions new sessions get."""

from __future__ import annotations

import re

import pytest

from app.services.accounts.accounts import Role
from app.services.accounts.audit_log import trail
from app.services.context import AppContext
from app.services.studies import repository
from tests.conftest import Clock

from .client import Api
from .conftest import Recruit
from .desk import Desk

PROLIFIC = (
    "recruitment: {platform: prolific, codes: {completed: C1AB, declined: C2CD}}\nplaces: 9\n"
)
SINGLE_USE = "recruitment: {links: single-use}\n"


@pytest.fixture
def desk(recruit: Recruit, client: Api, app: AppContext, request: pytest.FixtureRequest) -> Desk:
    """An admin at an open study whose plan has these further lines."""
    recruit(getattr(request, "param", ""))
    return Desk(client, app, "ada@lab.example", Role.ADMIN)


def test_without_a_platform_there_is_a_link_for_each(desk: Desk) -> None:
    page = desk.get("/studies/short/recruit").text
    address = "http://testserver/s/short"
    for link in (
        f">{address}<",
        (
            f">{address}?PROLIFIC_PID={{{{%PROLIFIC_PID%}}}}&amp;STUDY_ID={{{{%STUDY_ID%}}}}"
            "&amp;SESSION_ID={{%SESSION_ID%}}<"
        ),
        f">{address}?survey_code=%SURVEY_CODE%<",
    ):
        assert link in page
    for label in ("CloudResearch Connect", "Mechanical Turk", "SONA", "Prolific"):
        assert label in page


@pytest.mark.parametrize("desk", [PROLIFIC], indirect=True)
def test_a_platforms_study_shows_its_link_codes_and_places(
    desk: Desk, client: Api, clock: Clock
) -> None:
    client.cookies.clear()
    client.start(external_ids={"PROLIFIC_PID": "a"}).to_stage("completed", clock.forward)
    client.start(external_ids={"PROLIFIC_PID": "b"})
    page = desk.get("/studies/short/recruit").text
    assert 'data-testid="places-taken">2<' in page
    assert "of 9 places" in page
    assert "SURVEY_CODE" not in page
    for code in ("C1AB", "C2CD"):
        assert f"https://app.prolific.com/submissions/complete?cc={code}" in page


@pytest.mark.parametrize("desk", [SINGLE_USE], indirect=True)
def test_links_for_one_person_each_are_made_and_shown_once(
    desk: Desk, client: Api, app: AppContext
) -> None:
    made = desk.post("/studies/short/links", count="3", label="first round")
    links = re.findall(r"http://testserver(/s/short\?entry=[\w-]+)", made.text)
    assert len(set(links)) == 3
    page = desk.get("/studies/short/recruit").text
    assert not any(link in page for link in links)
    assert "0 of 3 have been used" in page
    client.cookies.clear()
    assert client.get(links[0]).status_code == 200
    entry = trail(app, "short")[0]
    assert (entry.action, entry.details) == ("links made", {"count": 3, "label": "first round"})
    assert desk.post("/studies/short/links", count="0").status_code == 422
    assert desk.post("/studies/short/links", count="100000").status_code == 422


def test_a_study_of_one_link_makes_no_others(desk: Desk) -> None:
    answer = desk.post("/studies/short/links", count="3")
    assert answer.status_code == 409
    assert "single-use" in answer.text


def test_conditions_are_switched_and_counted(
    desk: Desk, client: Api, app: AppContext, clock: Clock
) -> None:
    answer = desk.post("/studies/short/conditions", on=["pbpo", "no-skip"])
    assert answer.status_code == 303
    assert repository.find(app, "short").conditions_off == ("no-synthesis",)
    client.cookies.clear()
    client.start().to_stage("completed", clock.forward)
    client.start().to_first_query()
    page = desk.get("/studies/short/recruit").text
    rows = re.findall(r'<td class="number">(\d+)</td><td class="number">(\d+)</td>', page)
    active, completed = zip(*((int(a), int(c)) for a, c in rows), strict=True)
    assert (active[1], completed[1]) == (0, 0)
    assert (sum(active), sum(completed)) == (1, 2)
    assert page.count(" checked>") == 2
    refused = desk.post("/studies/short/conditions")
    assert refused.status_code == 409
    assert "at least one condition" in refused.text
    assert trail(app, "short")[0].details == {"off": ["no-synthesis"]}


def test_nobody_else_recruits_for_a_study(desk: Desk, client: Api, app: AppContext) -> None:
    for role, status in ((Role.EXPERIMENTER, 404), (Role.REVIEWER, 403)):
        other = Desk(client, app, f"{role}@lab.example", role)
        assert other.get("/studies/short/recruit").status_code == status
        assert other.post("/studies/short/links", count="1").status_code == status
        assert other.post("/studies/short/conditions", on=["pbpo"]).status_code == status
