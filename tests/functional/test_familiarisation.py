"""Videos to watch beforehand: what was watched is kept, and what is required is required."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

import pytest

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import SHORT_PLAN, Clock, StudyShelf

from .client import Api, Session

WATCHING_PLAN = SHORT_PLAN.replace(
    "familiarisation: {videos: 2, required: 0}",
    "familiarisation: {videos: 3, required: 2, speeds: [1, 2]}",
)

BLOCKS_PLAN = """
version: 1
slug: short
title: A study in blocks
languages: [en]
parameters: [{name: w0}, {name: w1}]
environments: {env1: {source: crane}, env2: {source: crane}}
conditions:
  - {name: clumps, method: knockout, environment: env1}
  - {name: straw, method: knockout, environment: env2}
blocks: environment
queries_per_trial: 1
break_s: 0
familiarisation: {videos: 4, required: 1}
"""


@pytest.fixture
def watching_study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, WATCHING_PLAN)
    return repository.find(app, "short")


@pytest.fixture
def study_in_blocks(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, BLOCKS_PLAN)
    return repository.find(app, "short")


def to_the_videos(client: Api) -> Session:
    session = client.start()
    session.consent()
    session.go_on()
    assert session.state["stage"] == "familiarisation"
    return session


def test_one_cannot_go_on_before_the_required_videos_were_watched(
    client: Api, watching_study: StudyInfo
) -> None:
    session = to_the_videos(client)
    for left in (2, 1):
        refusal = session.go_on()
        assert refusal.status_code == 409
        assert refusal.json()["type"] == "urn:pbpo-studio:problem:watch-more"
        assert refusal.json()["stage"] == "familiarisation"
        assert refusal.json()["videos_left"] == left
        assert session.call("watched", {"index": left}).status_code == 200
    assert session.state["familiarisation"]["watched"] == [1, 2]
    assert session.go_on().json()["stage"] == "query"


def test_a_video_watched_twice_counts_once_and_is_still_known_later(
    client: Api, watching_study: StudyInfo
) -> None:
    session = to_the_videos(client)
    for _ in range(2):
        session.call("watched", {"index": 0})
    assert session.look()["familiarisation"]["watched"] == [0]
    assert session.go_on().json()["videos_left"] == 1


@pytest.mark.parametrize(("index", "status"), [(3, 404), (-1, 422), (5000, 422), ("x", 422)])
def test_a_video_that_is_not_in_the_list_is_refused(
    client: Api, watching_study: StudyInfo, index: object, status: int
) -> None:
    assert to_the_videos(client).call("watched", {"index": index}).status_code == status


def test_watching_is_out_of_order_in_every_other_stage(
    client: Api, watching_study: StudyInfo
) -> None:
    session = client.start()
    refusal = session.call("watched", {"index": 0})
    assert (refusal.status_code, refusal.json()["stage"]) == (409, "consent")


def test_the_page_offers_the_speeds_and_is_shown_again_if_it_is_left_too_early(
    client: Api, watching_study: StudyInfo
) -> None:
    session = to_the_videos(client)
    client.cookies.set("pbpo_session_short", session.token)
    page = client.get("/s/short").text
    assert re.findall(r'data-speed="([\d.]+)"', page) == ["1.0", "2.0"]
    assert "Please watch at least 2 to the end." in page
    assert client.post("/s/short/continue").status_code == 303
    assert "Get to know the videos" in client.get("/s/short").text


def test_each_block_shows_videos_of_its_own_environment_and_asks_for_them_anew(
    client: Api, app: AppContext, study_in_blocks: StudyInfo, clock: Clock, api_token: str
) -> None:
    session = to_the_videos(client)
    shown = []
    for trial in (1, 2):
        assert session.state["stage"] == "familiarisation"
        assert session.state["progress"]["trial"] == trial - 1
        assert session.state["familiarisation"]["watched"] == []
        urls = [video["url"] for video in session.state["familiarisation"]["videos"]]
        opened = [app.addresses.opened(PurePosixPath(url).stem) for url in urls]
        shown.append({video.recording_id for video in opened if video is not None})
        assert session.go_on().status_code == 409
        session.call("watched", {"index": 3})
        assert session.look()["familiarisation"]["watched"] == [3]
        session.go_on()
        session.respond("left")
    assert session.state["stage"] == "debrief"

    own = {
        environment: {
            clip.id
            for clip in app.proposer.candidate_set(study_in_blocks.id, environment).all_recordings
        }
        for environment in ("env1", "env2")
    }
    queries = client.table("queries", api_token)
    for environment, videos in zip(queries["environment"], shown, strict=True):
        assert videos
        assert videos <= own[environment]
    assert set(queries["environment"]) == {"env1", "env2"}
