"""Recordings uploaded by machines: whole, in parts, cut, late, twice, damaged and hostile."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from sqlalchemy import select, update

from app.services.context import AppContext
from app.services.recordings.recordings import FoundSource
from app.services.rollouts import machines, outcomes, uploads
from app.services.runtime.errors import StoreAwayError
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Recording
from tests.conftest import Clock, StudyShelf

from .client import Api
from .machine_study import ROBOT_PLAN, Robot, add_candidates, ask, video_bytes
from .own_study import frames

VIDEO = video_bytes()
OTHER = video_bytes(200)


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"recording_limit_mb": 1})


@pytest.fixture
def study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, ROBOT_PLAN)
    return repository.find(app, "robot")


@pytest.fixture
def new_robot(app: AppContext, client: Api, study: StudyInfo) -> Callable[[str], Robot]:
    return lambda name: Robot(client, machines.add(app, study.slug, name))


@pytest.fixture
def robot(new_robot: Callable[[str], Robot]) -> Robot:
    return new_robot("arm")


@pytest.fixture
def asked(app: AppContext, study: StudyInfo) -> str:
    return ask(app, add_candidates(app, study.slug)[0])


def row(app: AppContext, public_id: str) -> Rollout:
    with app.database.read() as db:
        found = db.scalars(select(Rollout).where(Rollout.public_id == public_id)).one()
        assert found.recording is None or found.recording.locator
        return found


def partial_files(app: AppContext) -> list[Path]:
    return sorted((app.settings.uploads_dir / uploads.FOLDER).glob("*"))


def stored(app: AppContext, rollout: str, folder: Path) -> Path:
    """The file of the rollout's recording, from the store."""
    recording = row(app, rollout).recording
    assert recording is not None
    target = folder / recording.locator
    assert app.recordings.copy_to(FoundSource(recording.source, recording.locator), target)
    return target


def span(first: int, last: int, total: int = len(VIDEO)) -> dict[str, str]:
    return {"Content_Range": f"bytes {first}-{last - 1}/{total}"}


def test_a_recording_is_stored_with_its_pictures_and_the_hash_of_what_was_sent(
    app: AppContext, robot: Robot, asked: str, tmp_path: Path
) -> None:
    robot.claimed()
    answer = robot.put(asked, VIDEO, attempt=1)
    assert (answer.status_code, answer.json()["status"]) == (201, "recorded")
    found = row(app, asked)
    assert found.sha256 == hashlib.sha256(VIDEO).hexdigest()
    assert found.recording is not None
    assert found.recording.duration_s == pytest.approx(0.4)
    assert frames(stored(app, asked, tmp_path)) == frames(VIDEO)
    assert partial_files(app) == []


def test_the_same_bytes_again_change_nothing_and_other_bytes_are_refused(
    app: AppContext, robot: Robot, asked: str
) -> None:
    robot.claimed()
    robot.put(asked, VIDEO)
    assert robot.put(asked, VIDEO).status_code == 200
    refused = robot.put(asked, OTHER)
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("other-bytes")
    with app.database.read() as db:
        assert len(db.scalars(select(Recording)).all()) == 1
    assert partial_files(app) == []


def test_an_upload_goes_on_where_it_was_cut(
    app: AppContext, robot: Robot, asked: str, tmp_path: Path
) -> None:
    robot.claimed()
    half = len(VIDEO) // 2
    first = robot.put(asked, VIDEO[:half], **span(0, half))
    assert (first.status_code, first.json()) == (202, {"received": half, "total": len(VIDEO)})
    held = robot.put(asked, b"", Content_Range=f"bytes */{len(VIDEO)}")
    assert (held.status_code, held.json()["received"]) == (202, half)
    # A part that was sent already may come again.
    again = robot.put(asked, VIDEO[half - 10 : half + 10], **span(half - 10, half + 10))
    assert again.json()["received"] == half + 10
    last = robot.put(asked, VIDEO[half + 10 :], **span(half + 10, len(VIDEO)))
    assert last.status_code == 201
    assert frames(stored(app, asked, tmp_path)) == frames(VIDEO)


def test_a_part_that_leaves_a_gap_is_refused_with_what_has_arrived(
    robot: Robot, asked: str
) -> None:
    robot.claimed()
    robot.put(asked, VIDEO[:100], **span(0, 100))
    answer = robot.put(asked, VIDEO[200:], **span(200, len(VIDEO)))
    assert (answer.status_code, answer.json()["received"]) == (409, 100)


def test_what_came_before_the_line_was_cut_is_kept(
    app: AppContext, application: FastAPI, client: Api, robot: Robot, asked: str
) -> None:
    robot.claimed()
    half = len(VIDEO) // 2
    client.run(lambda _: _cut(application, robot, asked, VIDEO[:half]))
    held = robot.put(asked, b"", Content_Range=f"bytes */{len(VIDEO)}")
    assert held.json() == {"received": half, "total": len(VIDEO)}
    assert robot.put(asked, VIDEO[half:], **span(half, len(VIDEO))).status_code == 201


def test_parts_of_two_attempts_never_mix(
    app: AppContext, robot: Robot, asked: str, clock: Clock
) -> None:
    robot.claimed()
    robot.put(asked, VIDEO[:100], attempt=1, **span(0, 100))
    clock.forward(61)
    assert robot.claimed()["attempt"] == 2
    held = robot.put(asked, b"", attempt=2, Content_Range=f"bytes */{len(VIDEO)}")
    assert held.json()["received"] == 0


def test_a_digest_is_checked(app: AppContext, robot: Robot, asked: str) -> None:
    robot.claimed()
    right = base64.b64encode(hashlib.sha256(VIDEO).digest()).decode()
    wrong = base64.b64encode(hashlib.sha256(OTHER).digest()).decode()
    for headers in (
        {"Repr_Digest": f"sha-256=:{wrong}:"},
        {"Digest": f"SHA-256={wrong}"},
        {"Digest": f"sha-256={right}, sha-256={wrong}"},
        {"Repr_Digest": "sha-256=:!:"},
        {"Repr_Digest": f"sha-256=:{right}"},
    ):
        answer = robot.put(asked, VIDEO, **headers)
        assert answer.status_code == 422, headers
        # A damaged transfer is no failure of the machine: it sends the bytes again.
        assert row(app, asked).status == "claimed"
    headers = {"Repr_Digest": f"sha-256=:{right}:", "Digest": f"md5=x, sha-256={right}"}
    assert robot.put(asked, VIDEO, **headers).status_code == 201


@pytest.mark.parametrize(
    "headers",
    [
        {"Content_Range": "bytes 0-99"},
        {"Content_Range": "bytes 5-2/100"},
        {"Content_Range": "bytes 0-100/100"},
        {"Content_Range": "bytes 0-98/1000"},
        {"Content_Range": "bytes */100"},
        {"Content_Range": "lines 0-99/100"},
        {"Content_Range": "bytes 0-99/99999999999999999999"},
        {"Content_Encoding": "gzip"},
    ],
)
def test_headers_that_contradict_the_body_are_refused(
    robot: Robot, asked: str, headers: dict[str, str]
) -> None:
    robot.claimed()
    answer = robot.put(asked, b"x" * 100, **headers)
    assert answer.status_code == 422
    assert "expected" in answer.json()["detail"]


@pytest.mark.parametrize("sent", [b"", b"no video", VIDEO[: len(VIDEO) // 2], b"\0" * 5000])
def test_what_is_no_video_fails_the_attempt(
    app: AppContext, robot: Robot, asked: str, sent: bytes
) -> None:
    robot.claimed()
    answer = robot.put(asked, sent)
    assert answer.status_code == 422
    assert answer.json()["type"].endswith("recording-refused")
    found = row(app, asked)
    assert (found.status, found.recording_id) == ("asked", None)
    assert "video" in found.failures[0]["reason"]
    assert partial_files(app) == []


def test_a_recording_that_is_too_large_fails_the_attempt(
    app: AppContext, robot: Robot, asked: str
) -> None:
    robot.claimed()
    answer = robot.put(asked, b"x" * 1_000_001)
    assert answer.status_code == 422
    assert "1 MB" in answer.json()["detail"]
    assert row(app, asked).status == "asked"


def test_a_video_that_browsers_cannot_play_is_transcoded(
    app: AppContext, robot: Robot, asked: str, tmp_path: Path
) -> None:
    robot.claimed()
    sent = video_bytes(codec="mpeg4", form="avi")
    assert robot.put(asked, sent).status_code == 201
    assert row(app, asked).sha256 == hashlib.sha256(sent).hexdigest()
    assert stored(app, asked, tmp_path).suffix == ".mp4"


def test_a_late_recording_is_kept_if_nobody_else_has_recorded_it(
    app: AppContext, new_robot: Callable[[str], Robot], asked: str, clock: Clock
) -> None:
    late, other = new_robot("late"), new_robot("other")
    late.claimed()
    clock.forward(61)
    other.claimed()
    assert late.put(asked, VIDEO, attempt=1).status_code == 201
    found = row(app, asked)
    assert found.sha256 == hashlib.sha256(VIDEO).hexdigest()
    # The other one is told kindly, and its own recording is not mixed in.
    assert other.beat(asked).status_code == 409
    answer = other.put(asked, OTHER, attempt=2)
    assert (answer.status_code, answer.json()["kept"]) == (200, False)
    assert "another machine" in answer.json()["detail"]


def test_a_late_recording_after_the_last_attempt_is_kept_too(
    app: AppContext, robot: Robot, asked: str, clock: Clock
) -> None:
    for _ in range(2):
        robot.claimed()
        clock.forward(61)
    assert robot.claim().status_code == 204
    assert row(app, asked).status == "failed"
    assert robot.put(asked, VIDEO).status_code == 201
    assert row(app, asked).status == "recorded"


def test_a_recording_of_a_cancelled_rollout_is_answered_kindly_and_not_kept(
    app: AppContext, robot: Robot, study: StudyInfo, asked: str
) -> None:
    robot.claimed()
    with app.database.write() as db:
        outcomes.cancel(outcomes.locked(db, study.id, asked), "not needed", app.now())
    answer = robot.put(asked, VIDEO)
    assert (answer.status_code, answer.json()["kept"]) == (200, False)
    assert row(app, asked).recording_id is None


def test_numbers_of_the_machine_are_kept_with_the_recording(
    app: AppContext, robot: Robot, asked: str
) -> None:
    robot.claimed()
    series = {"time_s": [0, 0.5], "weight_g": [250.0, 0]}
    assert robot.measure(asked, score=-3.5, series=series, attempt=1).status_code == 200
    assert robot.put(asked, VIDEO).status_code == 201
    found = row(app, asked)
    assert (found.score, found.series) == (-3.5, series)


def test_an_upload_is_finished_later_when_the_store_was_away(
    app: AppContext, robot: Robot, asked: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.claimed()
    with monkeypatch.context() as patch:

        def away(_self: object, _videos: object) -> None:
            raise StoreAwayError("the store of recordings cannot be reached")

        patch.setattr(type(app.recordings), "keep_files", away)
        assert robot.put(asked, VIDEO).status_code == 503
    assert row(app, asked).status == "claimed"
    # Nothing has to be sent again.
    answer = robot.put(asked, b"", Content_Range=f"bytes */{len(VIDEO)}")
    assert answer.status_code == 201
    assert partial_files(app) == []


def test_partial_uploads_are_deleted_after_a_day(
    app: AppContext, robot: Robot, asked: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.claimed()
    robot.put(asked, VIDEO[:100], **span(0, 100))
    assert len(partial_files(app)) == 1
    assert uploads.delete_old(app) in (0, 1)
    for path in partial_files(app):
        os.utime(path, (0, 0))
    uploads.delete_old(app)
    assert partial_files(app) == []


def test_two_runs_with_the_same_pictures_share_a_file_and_have_a_recording_each(
    app: AppContext, robot: Robot, study: StudyInfo
) -> None:
    candidates = add_candidates(app, study.slug)
    for candidate in candidates[:2]:
        asked = ask(app, candidate)
        robot.claimed()
        assert robot.put(asked, VIDEO).status_code == 201
    with app.database.read() as db:
        assert len(db.scalars(select(Recording)).all()) == 2
        assert len(set(db.scalars(select(Recording.locator)))) == 1


def test_a_withdrawn_recording_is_not_replaced(app: AppContext, robot: Robot, asked: str) -> None:
    robot.claimed()
    robot.put(asked, VIDEO)
    with app.database.write() as db:
        db.execute(update(Rollout).values(status="withdrawn"))
    assert robot.put(asked, VIDEO).status_code == 200
    assert robot.put(asked, OTHER).status_code == 409


async def _cut(application: FastAPI, robot: Robot, rollout: str, sent: bytes) -> None:
    """A PUT whose connection ends before its body does."""
    messages = [
        {"type": "http.request", "body": sent, "more_body": True},
        {"type": "http.disconnect"},
    ]
    scope: dict[str, Any] = {
        "type": "http",
        "http_version": "1.1",
        "method": "PUT",
        "scheme": "http",
        "path": f"/api/v1/studies/robot/rollouts/{rollout}/recording",
        "raw_path": b"",
        "query_string": b"",
        "root_path": "",
        "headers": [
            (b"authorization", robot.headers["Authorization"].encode()),
            (b"content-length", str(len(VIDEO)).encode()),
        ],
        "client": ("127.0.0.1", 1),
        "server": ("testserver", 80),
        "extensions": {},
    }

    async def receive() -> Any:
        await asyncio.sleep(0)
        return messages.pop(0) if messages else {"type": "http.disconnect"}

    async def send(_message: Any) -> None:
        await asyncio.sleep(0)

    await application(scope, receive, send)
