"""Recordings of machines in an S3-compatible store: uploaded through the server, shown from it."""

from __future__ import annotations

import re

import httpx
import pytest

from app.services.context import AppContext
from app.services.recordings.stores import s3_client
from app.services.rollouts import machines, uploads
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import StudyShelf
from tests.s3_server import S3Server

from .client import Api
from .machine_study import ROBOT_PLAN, Robot, video_bytes
from .own_store import begin_anew, running, settings, store
from .own_study import frames

__all__ = ["running", "settings", "store"]


@pytest.fixture
def robot(app: AppContext, client: Api, study_shelf: StudyShelf) -> Robot:
    study_shelf.put_into(app, ROBOT_PLAN)
    study: StudyInfo = repository.find(app, "robot")
    return Robot(client, machines.add(app, study.slug, "arm"))


def test_what_a_machine_uploads_is_decoded_kept_in_the_store_and_shown_from_there(
    client: Api,
    app: AppContext,
    robot: Robot,
    store: S3Server,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A store that was away is asked again at once, not only after some seconds.
    monkeypatch.setattr(s3_client, "AWAY_S", 0)
    begin_anew(app)
    person = client.start("robot")
    person.consent()
    while person.state["stage"] != "query":
        person.go_on()
    damaged, first, second = b"no video", video_bytes(60), video_bytes(200)
    rollout = robot.claimed()["id"]
    assert robot.put(rollout, damaged).status_code == 422
    assert store.names() == []

    half = len(first) // 2
    part = robot.put(rollout, first[:half], Content_Range=f"bytes 0-{half - 1}/{len(first)}")
    assert (part.status_code, store.names()) == (202, [])
    store.stop()
    try:
        rest = f"bytes {half}-{len(first) - 1}/{len(first)}"
        assert robot.put(rollout, first[half:], Content_Range=rest).status_code == 503
    finally:
        store.start()
    # All bytes are here: nothing has to be sent again.
    held = robot.put(rollout, b"", Content_Range=f"bytes */{len(first)}")
    assert held.status_code == 201
    assert robot.put(robot.claimed()["id"], second).status_code == 201

    assert all(re.fullmatch(r"lab/one/uploads/[0-9a-f]{64}\.mp4", key) for key in store.names())
    assert len(store.names()) == 2
    assert list((app.settings.uploads_dir / uploads.FOLDER).iterdir()) == []
    query = person.look()["query"]
    links = [client.get(query[side]["url"]).headers["location"] for side in ("left", "right")]
    assert all(link.startswith(store.url) for link in links)
    shown = sorted(frames(httpx.get(link).content) for link in links)
    assert shown == sorted([frames(first), frames(second)])
