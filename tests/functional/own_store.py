"""A studio whose recordings are in an S3-compatible store: a test imports these fixtures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from app.services.context import AppContext
from app.services.recordings.recordings import Recordings
from app.services.runtime.settings import Settings
from tests.s3_server import BUCKET, KEY, SECRET, S3Server

from .own_study import folder, own_study

__all__ = ["folder", "own_study"]


@pytest.fixture(scope="module")
def running() -> Iterator[S3Server]:
    server = S3Server()
    yield server
    server.stop()


@pytest.fixture
def store(running: S3Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[S3Server]:
    """An empty store, with its keys where boto3 looks for them."""
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", KEY)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    running.asked.clear()
    yield running
    running.empty()


@pytest.fixture
def settings(store: S3Server, tmp_path: Path, media_dir: Path) -> Settings:
    return Settings(
        data_dir=tmp_path / "data",
        media_dir=media_dir,
        recordings_url=f"s3://{BUCKET}/lab/one",
        s3_endpoint=store.url,
    )


def begin_anew(app: AppContext) -> None:
    """As a server does that was just started: nothing of the store is remembered."""
    app.recordings.close()
    fresh = Recordings(app.database, app.background, app.settings)
    object.__setattr__(app, "recordings", fresh)
