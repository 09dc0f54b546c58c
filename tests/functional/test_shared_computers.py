"""One browser, several people: an identity in the request outranks the cookie of the last one."""

from __future__ import annotations

import re

import pytest

from app.services.arrival import entry_links
from app.services.context import AppContext
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api
from .conftest import Recruit
from .test_entry_links import NEEDED, SINGLE_USE, USED
from .test_leaving import rows_of_people
from .test_participant_pages import COOKIE, HEADINGS, agree, heading, sent_on, token_for
from .test_recruitment import PROLIFIC, identities
from .test_returning import session_of, sessions_and_people

IS_IT_YOU = "Is it you?"
MIDDLE_OR_END = pytest.mark.parametrize("stage", ["instructions", "query", "completed"])


@MIDDLE_OR_END
def test_the_next_personal_link_begins_the_next_persons_session(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock, stage: str
) -> None:
    recruit(SINGLE_USE)
    first, second = (link.removeprefix("/s/short") for link in entry_links.create(app, "short", 2))
    sent_on(agree(client, first))
    token = client.cookies[COOKIE]
    session_of(client, clock, stage)
    shown = heading(client.get(f"/s/short{first}"))
    assert shown != HEADINGS["consent"]

    page = client.get(f"/s/short{second}")
    assert heading(page) == HEADINGS["consent"]
    assert "receipt-code" not in page.text
    assert heading(client.get(f"/s/short/consent{second}")) == HEADINGS["consent"]
    sent_on(agree(client, second))
    assert client.cookies[COOKIE] != token
    assert sessions_and_people(app) == (2, 2)
    # The browser is the second one's now: the first link is of no use to anybody else at it.
    late = client.get(f"/s/short{first}")
    assert (late.status_code, heading(late)) == (403, USED)
    assert 'href="/s/short"' in late.text
    assert heading(client.get(f"/s/short{second}")) == "What you will do"


def test_a_made_up_link_shows_nothing_of_the_session_that_the_browser_holds(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(SINGLE_USE)
    agree(client, entry_links.create(app, "short", 1)[0].removeprefix("/s/short"))
    page = client.get("/s/short?entry=made-up")
    assert (page.status_code, heading(page)) == (403, NEEDED)


@MIDDLE_OR_END
def test_another_id_is_another_person(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock, stage: str
) -> None:
    recruit(PROLIFIC)
    agree(client, "?PROLIFIC_PID=one&SESSION_ID=s1")
    session_of(client, clock, stage)
    for other in ("?PROLIFIC_PID=two", "?SESSION_ID=s2", "?prolific_pid=two&session_id=s2"):
        assert heading(client.get(f"/s/short{other}")) == HEADINGS["consent"]
    for same in ("", "?PROLIFIC_PID=one", "?SESSION_ID=s1", "?PROLIFIC_PID={{%PROLIFIC_PID%}}"):
        assert heading(client.get(f"/s/short{same}")) != HEADINGS["consent"]
    sent_on(agree(client, "?PROLIFIC_PID=two&SESSION_ID=s2"))
    assert sessions_and_people(app) == (2, 2)


def test_an_id_that_the_session_lacks_is_added_after_asking(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(PROLIFIC)
    agree(client)
    session = session_of(client, clock, "query")
    link = "?PROLIFIC_PID=one&SESSION_ID=s1"
    page = client.get(f"/s/short{link}")
    assert heading(page) == IS_IT_YOU
    token = token_for(app)
    assert identities(client, token) == {}
    sent_on(client.post(f"/s/short/claim{link}"))
    assert heading(client.get(f"/s/short{link}")) == HEADINGS["query"]
    # Once kept, an id is never overwritten.
    client.post("/s/short/claim?PROLIFIC_PID=two&SESSION_ID=s1")
    client.post("/s/short/claim?PROLIFIC_PID=one&SESSION_ID=s2")
    headers = {"Authorization": session.headers["Authorization"]}
    assert client.get("/api/v1/session", headers=headers).json()["stage"] == "query"
    assert identities(client, token) == {"PROLIFIC_PID": "one", "SESSION_ID": "s1"}


def test_whoever_says_that_it_was_somebody_else_begins_anew(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock
) -> None:
    recruit(PROLIFIC)
    agree(client)
    session = session_of(client, clock, "query")
    link = "?PROLIFIC_PID=one"
    gone = client.post(f"/s/short/begin-anew{link}")
    assert (gone.status_code, gone.headers["location"]) == (303, f"/s/short{link}")
    sent_on(agree(client, link))
    assert sessions_and_people(app) == (2, 2)
    assert session.look()["stage"] == "query"


def test_an_id_of_somebody_who_has_begun_is_added_to_nobody_else(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit(PROLIFIC)
    client.start(external_ids={"PROLIFIC_PID": "one", "SESSION_ID": "s1"})
    agree(client)
    refused = client.post("/s/short/claim?PROLIFIC_PID=one")
    assert (refused.status_code, heading(refused)) == (409, "You have begun already")
    assert len(client.table("identities", token_for(app))) == 2


def test_the_end_of_a_nameless_session_is_not_shown_to_somebody_with_a_name(
    client: Api, recruit: Recruit, clock: Clock
) -> None:
    recruit(PROLIFIC)
    agree(client)
    session_of(client, clock, "completed")
    assert heading(client.get("/s/short?PROLIFIC_PID=one")) == HEADINGS["consent"]


def test_declining_by_a_link_of_ones_own_ends_nobody_elses_session(
    client: Api, recruit: Recruit, clock: Clock
) -> None:
    recruit(PROLIFIC)
    agree(client, "?PROLIFIC_PID=one")
    session = session_of(client, clock, "query")
    declined = client.post("/s/short/decline?PROLIFIC_PID=two")
    assert heading(declined) == HEADINGS["declined"]
    assert session.look()["stage"] == "query"


@MIDDLE_OR_END
def test_at_a_laboratorys_computer_the_next_person_begins_anew(
    client: Api, app: AppContext, short_study: StudyInfo, clock: Clock, stage: str
) -> None:
    agree(client)
    session = session_of(client, clock, stage)
    page = client.get("/s/short", headers={"Sec-Fetch-Site": "none"}).text
    assert "receipt-code" not in page
    assert re.search(r'href="/s/short/not-you"', page)
    asked = client.get("/s/short/not-you")
    assert heading(asked) == IS_IT_YOU
    assert 'data-testid="begin-anew"' in asked.text
    assert heading(client.get("/s/short")) != HEADINGS["consent"]
    sent_on(client.post("/s/short/begin-anew"))
    assert COOKIE not in client.cookies
    sent_on(agree(client))
    assert sessions_and_people(app) == (2, 2)
    assert session.look()["stage"] == stage
    assert rows_of_people(app)["participants"] == 2
