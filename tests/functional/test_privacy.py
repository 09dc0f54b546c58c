"""What is kept of an evaluator: a page that says so, from every page of the study."""

from __future__ import annotations

import re

import pytest

from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api
from .conftest import Recruit
from .test_participant_pages import HEADINGS, heading, in_browser
from .test_recruitment import PROLIFIC

PLATFORM_LINE = "The identifiers that Prolific puts into your link"
DEVICE_LINE = "From the device check"
QUESTIONS_LINE = "Your answers to the questionnaires"

ASKING = """
device_check: {min_width_px: 300}
questionnaires: {end: [{name: age, type: number, label: "How old are you?"}]}
contact: ada@lab.example
"""


def test_the_page_can_be_read_before_one_begins_and_keeps_nothing(
    client: Api, short_study: StudyInfo
) -> None:
    page = client.get("/s/short/privacy")
    assert (page.status_code, heading(page)) == (200, "Your privacy")
    assert f"for {short_study.plan.session_expires_after_days} days" in page.text
    assert "set-cookie" not in page.headers
    assert client.get("/s/nowhere/privacy").status_code == 404


def test_it_says_what_this_study_keeps_and_no_more(client: Api, recruit: Recruit) -> None:
    recruit("")
    plain = client.get("/s/short/privacy").text
    assert not any(line in plain for line in (PLATFORM_LINE, DEVICE_LINE, QUESTIONS_LINE))


def test_it_says_what_a_study_asks_for_besides(client: Api, recruit: Recruit) -> None:
    recruit(PROLIFIC + ASKING)
    full = client.get("/s/short/privacy?PROLIFIC_PID=5f0c").text
    for line in (PLATFORM_LINE, DEVICE_LINE, QUESTIONS_LINE, "Contact ada@lab.example"):
        assert line in full
    # A newcomer's way back keeps who they are.
    assert 'href="/s/short?PROLIFIC_PID=5f0c"' in full


@pytest.mark.parametrize("stage", ["instructions", "query", "break", "completed", "withdrawn"])
def test_every_page_leads_there_and_back(
    client: Api, short_study: StudyInfo, clock: Clock, stage: str
) -> None:
    in_browser(client, stage, clock)
    before = client.get("/s/short")
    found = re.search(r'href="([^"]+)" data-testid="privacy"', before.text)
    assert found
    assert heading(client.get(found[1])) == "Your privacy"
    assert heading(client.get("/s/short")) == heading(before)


def test_newcomers_and_leavers_are_led_there_too(client: Api, short_study: StudyInfo) -> None:
    for path in ("/s/short", "/s/short/delete", "/s/short/deleted"):
        assert 'data-testid="privacy"' in client.get(path).text
    assert heading(client.get("/s/short")) == HEADINGS["consent"]


def test_it_says_for_how_long_where_the_study_has_a_rule(client: Api, recruit: Recruit) -> None:
    recruit(PROLIFIC + "retention: {identity_days: 30, everything_days: 365}\n")
    page = client.get("/s/short/privacy").text
    assert "Everything is deleted 365 days after your session has ended." in page
    assert "The identifiers of Prolific are deleted 30 days after" in page
    assert "Until the people who run the study delete it" not in page
