"""Back after too long: what `recruitment.returning` and `resume.policy` say together."""

from __future__ import annotations

import pytest

from app.services.context import AppContext
from tests.conftest import Clock

from .client import Api
from .conftest import Recruit
from .test_participant_pages import HEADINGS, agree, heading, sent_on
from .test_places import AWAY
from .test_returning import LINK, in_another_browser, recruitment, session_of, sessions_and_people

HOURS = 2
ONCE = "You have taken part already"
CONSENT = HEADINGS["consent"]


def left_for_too_long(
    client: Api, recruit: Recruit, clock: Clock, returning: str, policy: str
) -> None:
    recruit(f"{recruitment(returning)}resume: {{policy: {policy}, max_age_hours: {HOURS}}}\n")
    agree(client, LINK)
    session_of(client, clock, "query")
    clock.forward(HOURS * 3600)


@pytest.mark.parametrize(
    ("returning", "policy", "title"),
    [
        ("resume", "resume", CONSENT),
        ("resume", "restart", CONSENT),
        ("resume", "block", AWAY),
        ("again", "resume", CONSENT),
        ("again", "restart", CONSENT),
        ("again", "block", AWAY),
        ("block", "resume", ONCE),
        ("block", "restart", ONCE),
        ("block", "block", ONCE),
    ],
)
def test_in_another_browser(
    client: Api,
    recruit: Recruit,
    app: AppContext,
    clock: Clock,
    returning: str,
    policy: str,
    title: str,
) -> None:
    left_for_too_long(client, recruit, clock, returning, policy)
    in_another_browser(client)
    assert heading(client.get(f"/s/short{LINK}")) == title
    if title == CONSENT:
        sent_on(agree(client, LINK))
        assert heading(client.get("/s/short")) == "What you will do"
        # Nothing proves that it is the same person: what either deletes is their own.
        assert sessions_and_people(app) == (2, 2)
    else:
        assert sessions_and_people(app) == (1, 1)


@pytest.mark.parametrize("returning", ["resume", "again", "block"])
def test_in_the_same_browser_a_study_that_lets_one_begin_anew_does_so_whoever_may_return(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock, returning: str
) -> None:
    left_for_too_long(client, recruit, clock, returning, "restart")
    assert heading(client.get(f"/s/short{LINK}")) == CONSENT
    sent_on(agree(client, LINK))
    assert heading(client.get("/s/short")) == "What you will do"
    assert sessions_and_people(app) == (2, 1)


@pytest.mark.parametrize(("returning", "is_invited"), [("resume", True), ("block", False)])
def test_nobody_is_invited_to_begin_again_who_would_then_be_refused(
    client: Api, recruit: Recruit, clock: Clock, returning: str, is_invited: bool
) -> None:
    left_for_too_long(client, recruit, clock, returning, "resume")
    page = client.get(f"/s/short{LINK}")
    assert heading(page) == AWAY
    assert ("open the study again" in page.text) is is_invited
    assert heading(client.get(f"/s/short{LINK}")) == (CONSENT if is_invited else ONCE)
