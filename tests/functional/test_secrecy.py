"""What an evaluator's browser is sent tells nothing of what is compared, or how."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from typing import Any

import pytest

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import FROM_PROLIFIC, Clock, StudyShelf

from .client import Api, Session, by_turns
from .conftest import LEARNING_PLAN

State = dict[str, Any]

#: All that a state may hold; a new key has to be thought about before it is added here.
ALLOWED = {
    *("stage", "progress", "trial", "trials", "query", "queries", "study", "slug", "title"),
    *("contact", "language", "consent", "version", "html", "instructions", "familiarisation"),
    *("videos", "required", "watched", "speeds", "url", "duration_s", "id", "left", "right"),
    *("skip", "next_skip", "label", "stages"),
    *("prefetch", "break", "break_s", "ends_at", "seconds_left", "debrief"),
    # The way back to a platform.
    *("completed", "code", "platform"),
}
#: What the study knows and an evaluator must not: conditions, methods, environments, settings.
TELLING = re.compile(
    r"pbpo-no|no-synthesis|no-skip|knockout|thompson|synthesis|acquisition|"
    r"env1|env2|\bw0\b|\bw1\b|score|candidate|recording|seed|\bcrane\b|posterior|method|condition",
    re.IGNORECASE,
)
OPAQUE = re.compile(r"/media/[A-Za-z0-9_-]{46}\.mp4")
#: Drawn by chance: now and then such a name spells a word.
NAMES = re.compile(r"/media/[A-Za-z0-9_-]{46}\.mp4|\b[A-Za-z0-9]{22}\b")


def telling(text: str) -> list[str]:
    """What a text says of the study, leaving out names that were drawn."""
    found: list[str] = TELLING.findall(NAMES.sub("", text))
    return found


def walk(value: Any, path: str = "") -> Iterator[tuple[str, str, Any]]:
    """Every key of a state with its path and what it holds, if that is no further mapping."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield f"{path}/{key}", key, None if isinstance(inner, dict | list) else inner
            yield from walk(inner, f"{path}/{key}")
    elif isinstance(value, list):
        for inner in value:
            if isinstance(inner, dict | list):
                yield from walk(inner, path)
            else:
                yield path, "", inner


@pytest.fixture
def from_prolific(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    """The learning study, whose participants come with identifiers."""
    study_shelf.put_into(app, LEARNING_PLAN + FROM_PROLIFIC)
    return repository.find(app, "short")


def states(client: Api, clock: Clock) -> Iterator[State]:
    """Every state of a whole session, as each call answers it."""
    db: Session = client.start(external_ids={"PROLIFIC_PID": "5f0c1ada"})
    yield db.state
    choose = by_turns("left", "right", "skip")
    while db.state["stage"] != "completed":
        response = choose(db.state) if db.state["stage"] == "query" else ""
        db.step(response, clock.forward)
        yield db.state
        yield db.look()


def test_no_state_holds_a_key_that_nobody_thought_about(
    client: Api, from_prolific: StudyInfo, clock: Clock
) -> None:
    unknown = {
        path
        for state in states(client, clock)
        for path, key, _ in walk(state)
        if key and key not in ALLOWED
    }
    assert unknown == set()


def test_no_state_tells_what_is_compared(
    client: Api, from_prolific: StudyInfo, clock: Clock
) -> None:
    for state in states(client, clock):
        told = [
            (path, value)
            for path, _, value in walk(state)
            if isinstance(value, str) and telling(value)
        ]
        assert told == []
        assert "5f0c1ada" not in str(state)
        urls = re.findall(r"/media/[^'\"]*", str(state))
        assert all(OPAQUE.fullmatch(url) for url in urls)


def test_numbers_in_a_query_say_nothing_but_how_long_a_video_is(
    client: Api, learning_study: StudyInfo
) -> None:
    query = client.start().to_first_query().state["query"]
    numbers = [(key, value) for _, key, value in walk(query) if isinstance(value, int | float)]
    assert numbers == [("duration_s", 10.0), ("duration_s", 10.0)]


@pytest.mark.parametrize("stage", ["consent", "familiarisation", "query", "break", "completed"])
def test_no_page_tells_what_is_compared(
    client: Api, learning_study: StudyInfo, clock: Clock, stage: str
) -> None:
    session = client.start().to_stage(stage, clock.forward)
    client.cookies.set("pbpo_session_short", session.token)
    page = html.unescape(client.get("/s/short").text).replace('method="post"', "")
    assert telling(page) == []


def test_addresses_of_videos_follow_no_order(
    client: Api, learning_study: StudyInfo, api_token: str
) -> None:
    recordings = client.table("recordings", api_token)
    ids = recordings["public_id"]
    assert ids.is_unique
    assert ids.str.fullmatch("[A-Za-z0-9]{22}").all()
    ranks = ids.rank()
    assert abs(ranks.corr(recordings["candidate"])) < 0.15
    assert abs(ranks.corr(recordings["score"])) < 0.15


def test_the_document_of_the_api_names_no_method(client: Api) -> None:
    document = client.get("/openapi.json").text
    assert re.findall(r"pbpo-no|knockout|thompson|env1|env2", document) == []
