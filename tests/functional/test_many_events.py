"""More events than are kept: the answer is taken, the rest is counted and told."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from app.services.context import AppContext
from app.services.monitoring.incidents import incidents
from app.services.sessions import event_limits, video_faults
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import SHORT_PLAN, StudyShelf

from .client import Api, Session

SCRIPTS = Path(__file__).parents[2] / "static" / "js"
MORE = "events_left_out"


def event(name: str = "stall", at: int = 1, **more: Any) -> dict[str, Any]:
    return {"event": name, "time_ms": at, **more}


def kept(client: Api, api_token: str) -> Any:
    return client.table("events", api_token)


def left_out(client: Api, api_token: str) -> list[int]:
    table = kept(client, api_token)
    return [int(value) for value in table[table["event"] == "left_out"]["value"]]


def told(app: AppContext) -> list[str]:
    study = repository.find(app, "short")
    return [one.said for one in incidents(app, study) if one.name == "events"]


@pytest.mark.parametrize("number", [61, 1_001, 5_000])
def test_an_answer_with_too_many_events_is_taken(
    client: Api, app: AppContext, short_study: StudyInfo, api_token: str, number: int
) -> None:
    session = client.start().to_first_query()
    seen = [event(at=at) for at in range(number - 1)] + [event("watched", number, value=0.5)]
    answer = session.respond("left", events=seen, rt_ms=900, replays=2)
    assert answer.status_code == 200, answer.text
    assert session.state["progress"]["query"] == 2

    table = kept(client, api_token)
    assert len(table) == event_limits.MAX_EVENTS_PER_CALL + 2
    # What is told in the end is among what is kept.
    assert table["event"].to_list()[-3:] == ["watched", "replays", "left_out"]
    assert left_out(client, api_token) == [number - event_limits.MAX_EVENTS_PER_CALL]
    (sentence,) = told(app)
    assert sentence.startswith(f"{number - 60:,} event" if number > 61 else "One event")
    assert len(client.table("queries", api_token)["response"].dropna()) == 1


def test_what_a_page_did_not_send_is_counted_too(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    assert session.respond("left", events=[event()] * 70, **{MORE: 5}).status_code == 200
    assert left_out(client, api_token) == [15]


def test_events_of_unknown_names_are_counted_and_long_values_cut(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    session = client.start().to_first_query()
    # Those by which the server marks what does not count are no browser's to send.
    seen = [event("made-up"), event("set_aside"), event("undone"), event("left_out", value=7)]
    answer = session.respond("left", events=[*seen, event("error", value="x" * 5_000)])
    assert answer.status_code == 200
    table = kept(client, api_token)
    assert table["event"].to_list() == ["error", "left_out"]
    assert table["value"].str.len().max() <= event_limits.LONGEST_VALUE
    assert left_out(client, api_token) == [4]


def test_a_session_that_sends_without_end_stores_no_more(
    client: Api, app: AppContext, short_study: StudyInfo, api_token: str, monkeypatch: Any
) -> None:
    monkeypatch.setattr(event_limits, "MAX_EVENTS_PER_SESSION", 130)
    monkeypatch.setattr(event_limits, "MAX_EVENTS_PER_PAIR", 1)
    session = client.start().to_first_query()
    for _ in range(4):
        assert report(session, [event()] * 1_000).status_code == 200
    assert session.respond("left", events=[event()] * 10).status_code == 200
    table = kept(client, api_token)
    assert (table["event"] == "stall").sum() <= 130
    assert sum(left_out(client, api_token)) + (table["event"] == "stall").sum() == 4_010
    assert told(app)


def test_a_session_sets_a_bounded_number_of_pairs_aside(
    client: Api, short_study: StudyInfo, monkeypatch: Any
) -> None:
    monkeypatch.setattr(video_faults, "MOST_FAULTS", 3)
    session = client.start().to_first_query()
    assert [report(session, []).status_code for _ in range(2)] == [200, 200]
    session.respond("left")
    assert [report(session, []).status_code for _ in range(2)] == [200, 409]
    # The pair that is on the page can still be answered.
    assert session.respond("left").status_code == 200


def report(session: Session, events: list[dict[str, Any]]) -> Any:
    return session.call("faults", {"query_id": session.state["query"]["id"], "events": events})


def test_a_long_study_keeps_what_its_pages_tell(app: AppContext, study_shelf: StudyShelf) -> None:
    study_shelf.put_into(app, SHORT_PLAN)
    plan = repository.find(app, "short").plan
    assert event_limits.max_events(plan) == event_limits.MAX_EVENTS_PER_SESSION
    long = plan.model_copy(update={"queries_per_trial": 100})
    assert event_limits.max_events(long) == event_limits.MAX_EVENTS_PER_PAIR * 100 * plan.trials


def test_every_event_that_a_page_tells_is_known() -> None:
    named = set()
    for script in SCRIPTS.glob("*.js"):
        named |= set(
            re.findall(r'(?:evidence\.add|this\.add|onEvent)\("(\w+)"', script.read_text("utf-8"))
        )
    assert len(named) > 12
    assert named <= event_limits.NAMES


def test_a_page_sends_no_more_than_is_kept() -> None:
    script = (SCRIPTS / "evidence.js").read_text("utf-8")
    found = re.search(r"MOST_EVENTS = (\d+);", script)
    assert found is not None
    # Seven come in the end, and the press.
    assert int(found[1]) + 8 <= event_limits.MAX_EVENTS_PER_CALL
