"""What a killed process leaves of a video that it was writing."""

from __future__ import annotations

import asyncio
import os
import time
from datetime import timedelta
from pathlib import Path

import pytest

from app.main import create_app
from app.services.context import AppContext
from app.services.maintenance import partial_files
from app.services.runtime.settings import Settings
from tests.conftest import STARTED

DAY = timedelta(days=1)
RENDERING = f".{'a' * 32}.{'b' * 32}.part"
KEEPING = f"{'c' * 64}.mp4.4711.part"


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "data", media_dir=tmp_path / "media")


def write(folder: Path, name: str, age: timedelta) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_bytes(b"half a video")
    at = (STARTED - age).timestamp()
    os.utime(path, (at, at))
    return path


def test_what_nobody_has_written_to_for_a_day_goes_and_nothing_else(app: AppContext) -> None:
    media, own = app.settings.media_dir, app.settings.own_videos
    old = [write(media, RENDERING, DAY), write(own, KEEPING, 9 * DAY)]
    kept = [
        # Another process may be at it.
        write(media, RENDERING.replace("b", "d"), timedelta(hours=23)),
        write(media, f"{'a' * 32}.mp4", 9 * DAY),
        write(media, "somebodys-download.part", 9 * DAY),
        write(own / "drafts" / "one", ".a.mp4.part", 9 * DAY),
    ]
    assert partial_files.delete_partial(app, lambda: True) == 0
    assert partial_files.delete_partial(app) == len(old)
    assert not any(path.exists() for path in old)
    assert all(path.exists() for path in kept)


def test_it_goes_although_another_process_has_just_removed_some(
    app: AppContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone, left = (write(app.settings.media_dir, f".{c * 64}.x.part", DAY) for c in "ab")
    found = [gone, left]
    monkeypatch.setattr(partial_files, "_unfinished", lambda _folder: found)
    gone.unlink()
    partial_files.delete_partial(app)
    assert not left.exists()


def test_a_server_removes_it_when_it_starts(app: AppContext) -> None:
    old = write(app.settings.media_dir, RENDERING, DAY)
    server = create_app(app=app)

    async def run() -> None:
        async with server.router.lifespan_context(server):
            deadline = time.monotonic() + 30
            while old.exists() and time.monotonic() < deadline:
                await asyncio.sleep(0.01)

    asyncio.run(run())
    assert not old.exists()


def test_one_that_cannot_be_removed_keeps_no_other(app: AppContext) -> None:
    media = app.settings.media_dir
    stuck = media / f".{'0' * 32}.x.part"
    (stuck / "within").mkdir(parents=True)
    at = (STARTED - DAY).timestamp()
    os.utime(stuck, (at, at))
    gone = write(media, f".{'f' * 32}.x.part", DAY)
    assert partial_files.delete_partial(app) == 1
    assert stuck.exists()
    assert not gone.exists()
