"""The same person coming twice, known by what their platform calls them."""

from __future__ import annotations

import re

import httpx
import pytest

from app.services import studies
from app.services.studio import Studio
from app.study.recruitment import Recruitment
from tests.conftest import Clock

from .client import Api, Session
from .conftest import Recruit
from .test_leaving import rows_of_people, shown_receipt
from .test_participant_pages import COOKIE, HEADINGS, agree, heading, sent_on, token_for
from .test_recruitment import PROLIFIC, identities, return_link

LINK = "?PROLIFIC_PID=5f0c&SESSION_ID=first"
AGAIN = "?PROLIFIC_PID=5f0c&SESSION_ID=second"


def recruitment(returning: str) -> str:
    return f"{PROLIFIC}  returning: {returning}\n"


def in_another_browser(client: Api) -> None:
    client.cookies.clear()


def session_of(client: Api, clock: Clock, stage: str) -> Session:
    """The browser's own session, brought to a stage."""
    token = client.cookies[COOKIE]
    session = Session(client, token, {})
    session.look()
    return session.to_stage(stage, clock.forward)


def sessions_and_people(studio: Studio) -> tuple[int, int]:
    rows = rows_of_people(studio)
    return rows.get("sessions", 0), rows.get("participants", 0)


def test_taking_people_back_is_what_happens_unless_the_study_says_otherwise() -> None:
    assert Recruitment().returning == "resume"


def test_whoever_comes_back_in_another_browser_goes_on_where_they_were(
    client: Api, recruit: Recruit, studio: Studio, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    before = session_of(client, clock, "query").look()
    in_another_browser(client)

    arrived = client.get(f"/s/short{AGAIN}")
    sent_on(arrived)
    assert "HttpOnly" in arrived.headers["set-cookie"]
    assert heading(client.get("/s/short")) == HEADINGS["query"]
    after = client.get("/api/v1/session", headers={"PBPO-Study": "short"}).json()
    assert after["query"]["id"] == before["query"]["id"]
    assert sessions_and_people(studio) == (1, 1)
    kept = identities(client, token_for(studio))
    assert kept == {"PROLIFIC_PID": "5f0c", "SESSION_ID": "second"}


def test_the_first_browser_and_both_receipts_stay_good(
    client: Api, recruit: Recruit, studio: Studio, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    first_receipt = shown_receipt(client)
    first = session_of(client, clock, "completed")
    in_another_browser(client)
    client.get(f"/s/short{LINK}")
    second_receipt = shown_receipt(client)
    assert second_receipt not in (None, first_receipt)
    assert first.look()["stage"] == "completed"

    gone = client.post("/api/v1/studies/short/deletions", json={"receipt": second_receipt})
    assert gone.status_code == 204
    assert rows_of_people(studio) == {"tombstones": 1}
    again = client.post("/api/v1/studies/short/deletions", json={"receipt": first_receipt})
    assert again.status_code == 404


def test_whoever_has_completed_finds_the_code_again(
    client: Api, recruit: Recruit, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    session_of(client, clock, "completed")
    in_another_browser(client)
    client.get(f"/s/short{AGAIN}")
    assert (return_link(client.get("/s/short").text) or "").endswith("cc=COMPLETE1")


def test_taken_back_even_into_a_study_that_is_closed_by_now(
    client: Api, recruit: Recruit, studio: Studio, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    session_of(client, clock, "query")
    studies.close_study(studio, "short")
    in_another_browser(client)
    sent_on(client.get(f"/s/short{AGAIN}"))
    assert heading(client.get("/s/short")) == HEADINGS["query"]


def test_a_session_that_was_left_for_too_long_is_begun_again_by_the_same_participant(
    client: Api, recruit: Recruit, studio: Studio, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    clock.forward(15 * 24 * 3600)
    in_another_browser(client)
    assert heading(client.get(f"/s/short{AGAIN}")) == HEADINGS["consent"]
    sent_on(agree(client, AGAIN))
    assert sessions_and_people(studio) == (2, 1)


@pytest.mark.parametrize("stage", ["query", "completed"])
def test_a_study_that_takes_each_person_once_says_so_on_a_page_of_its_own(
    client: Api, recruit: Recruit, studio: Studio, clock: Clock, stage: str
) -> None:
    recruit(recruitment("block"))
    agree(client, LINK)
    session_of(client, clock, stage)
    in_another_browser(client)
    page = client.get(f"/s/short{AGAIN}")
    assert (page.status_code, heading(page)) == (409, "You have taken part already")
    assert "set-cookie" not in page.headers
    # Whoever comes back for the code alone still gets it.
    code = return_link(page.text)
    assert (code is not None) == (stage == "completed")
    assert sessions_and_people(studio) == (1, 1)


def test_a_second_window_that_agrees_later_is_stopped_as_well(
    client: Api, recruit: Recruit, studio: Studio
) -> None:
    recruit(recruitment("block"))
    page = client.get(f"/s/short{LINK}")
    found = re.search(r'name="version" value="([0-9a-f]+)"', page.text)
    assert found
    agree(client, LINK)
    in_another_browser(client)
    late = client.post(f"/s/short/consent{LINK}", data={"version": found[1]})
    assert (late.status_code, heading(late)) == (409, "You have taken part already")
    assert sessions_and_people(studio) == (1, 1)


def test_a_study_may_take_a_person_as_often_as_they_come(
    client: Api, recruit: Recruit, studio: Studio, clock: Clock
) -> None:
    recruit(recruitment("again"))
    for link in (LINK, AGAIN):
        sent_on(agree(client, link))
        session_of(client, clock, "completed")
        in_another_browser(client)
    assert sessions_and_people(studio) == (2, 1)
    table = client.table("participants", token_for(studio))
    assert table["sessions"].to_list() == [2]


def test_deletion_takes_every_session_of_the_person(
    client: Api, recruit: Recruit, studio: Studio, clock: Clock
) -> None:
    recruit(recruitment("again"))
    for link in (LINK, AGAIN):
        agree(client, link)
        session = session_of(client, clock, "query")
        in_another_browser(client)
    session.call("withdraw", {"delete": True})
    assert rows_of_people(studio) == {"tombstones": 2}


def test_whoever_had_everything_deleted_or_declined_is_a_newcomer_again(
    client: Api, recruit: Recruit, studio: Studio
) -> None:
    recruit(recruitment("block"))
    ids = {"PROLIFIC_PID": "5f0c"}
    client.start(external_ids=ids).call("withdraw")
    client.start(external_ids=ids).call("withdraw", {"delete": True})
    assert heading(client.get(f"/s/short{LINK}")) == HEADINGS["consent"]


def test_on_a_shared_computer_the_next_person_does_not_find_the_last_ones_session(
    client: Api, recruit: Recruit, studio: Studio, clock: Clock
) -> None:
    recruit(recruitment("resume"))
    agree(client, LINK)
    session_of(client, clock, "completed")
    other = "?PROLIFIC_PID=somebody-else"
    assert heading(client.get(f"/s/short{other}")) == HEADINGS["consent"]
    sent_on(agree(client, other))
    assert sessions_and_people(studio) == (2, 2)
    assert heading(client.get(f"/s/short{other}")) == "What you will do"
    assert heading(client.get("/s/short")) == "What you will do"


# By the API


def begin(client: Api, **body: object) -> httpx.Response:
    return client.post("/api/v1/studies/short/sessions", json=body)


def test_the_api_takes_back_blocks_and_begins_again_alike(
    client: Api, recruit: Recruit, studio: Studio
) -> None:
    ids = {"PROLIFIC_PID": "5f0c"}
    recruit(recruitment("resume"))
    first = Session(client, begin(client, external_ids=ids).json()["token"], {})
    first.look()
    first.to_first_query()
    back = begin(client, external_ids=ids).json()
    assert back["session"]["stage"] == "query"
    assert back["token"] != first.token
    assert sessions_and_people(studio) == (1, 1)


def test_the_api_refuses_with_a_type_of_its_own(client: Api, recruit: Recruit) -> None:
    recruit(recruitment("block"))
    begin(client, external_ids={"PROLIFIC_PID": "5f0c"})
    refusal = begin(client, external_ids={"PROLIFIC_PID": "5f0c"})
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:already-taken-part"
    assert begin(client, external_ids={"PROLIFIC_PID": "other"}).status_code == 201
    assert begin(client).status_code == 201


def test_a_preview_is_nobodys_first_time(client: Api, recruit: Recruit, studio: Studio) -> None:
    recruit(recruitment("block"))
    ids = {"PROLIFIC_PID": "5f0c"}
    client.start(mode="preview", by=token_for(studio), external_ids=ids)
    assert begin(client, external_ids=ids).status_code == 201


def test_without_a_platform_nobody_is_recognised(client: Api, recruit: Recruit) -> None:
    recruit("\nrecruitment: {returning: block}\n")
    for _ in range(2):
        sent_on(agree(client, "?PROLIFIC_PID=5f0c"))
        in_another_browser(client)
