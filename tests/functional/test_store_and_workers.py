"""A store of recordings that goes away while a worker makes what somebody waits for."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from sqlalchemy import text

from app.crane import library
from app.main import create_app
from app.services.background.remote import WorkerFailedError
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.maintenance import worker_tasks
from app.services.maintenance.worker_tasks import HeartbeatConfig, WorkerTasks
from app.services.recordings import recordings
from app.services.recordings.recordings import CRANE, FoundSource
from app.services.recordings.stores import s3_client
from app.services.runtime.settings import Settings
from app.storage.task_queue import RENDER, TaskQueue
from tests.databases import PostgresServer
from tests.s3_server import BUCKET, S3Server

from .apart import app, queue, server
from .client import Api
from .own_store import running, store
from .test_videos_that_go import Here
from .workers import PATIENCE_S, until

__all__ = ["app", "queue", "running", "server", "store"]

pytestmark = pytest.mark.postgresql

LOCATOR = "env1/0/0"


@pytest.fixture
def settings(server: PostgresServer, store: S3Server, tmp_path: Path) -> Settings:
    made = Settings(
        database_url=server.new(tmp_path),
        data_dir=tmp_path / "data",
        media_dir=tmp_path / "media",
        recordings_url=f"s3://{BUCKET}/lab/one",
        s3_endpoint=store.url,
        workers_apart=True,
    )
    # What is to be put into the store has been rendered already.
    made.media_dir.mkdir()
    (made.media_dir / library.video_name("env1", 0, 0)).write_bytes(b"a video")
    return made


@pytest.fixture
def tasks(
    settings: Settings, queue: TaskQueue, monkeypatch: pytest.MonkeyPatch
) -> Iterator[WorkerTasks]:
    """A worker's, in this process; nobody waits until it tries again."""
    monkeypatch.setattr(worker_tasks, "_PASSES_S", 0)
    monkeypatch.setattr(s3_client, "AWAY_S", 0)
    recordings._stores.cache_clear()
    worker = open_app(settings, background=Here(1))
    made = WorkerTasks(worker, queue, HeartbeatConfig())
    yield made
    made.stop()
    worker.close()
    recordings._stores.cache_clear()


async def do_what_waits(tasks: WorkerTasks) -> None:
    async with tasks.app().open_async() as queue_app:
        await queue_app.run_worker_async(
            queues=[RENDER],
            wait=False,
            install_signal_handlers=False,
            delete_jobs="successful",
        )


def test_who_waits_is_told_that_the_store_is_away_and_has_the_video_when_it_is_back(
    app: AppContext, queue: TaskQueue, store: S3Server, tasks: WorkerTasks
) -> None:
    with (
        Api(create_app(app=app), follow_redirects=False) as client,
        ThreadPoolExecutor(1) as thread,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(app.recordings, "find", lambda _: FoundSource(CRANE, LOCATOR))
        # The server has looked, and left the video to a worker.
        asked = thread.submit(client.get, "/media/any.mp4")
        until(lambda: queue.count(RENDER) == (1, 0), "it was asked for")
        store.stop()
        try:
            asyncio.run(do_what_waits(tasks))
            refusal = asked.result(PATIENCE_S)
        finally:
            store.start()
        assert refusal.status_code == 503, refusal.text
        assert refusal.json()["detail"] == "the store of recordings cannot be reached"
        with app.database.read() as db:
            tried = db.scalar(
                text("SELECT attempts FROM procrastinate.procrastinate_jobs WHERE status='failed'")
            )
        assert tried == worker_tasks.MOST_LOSSES

        again = thread.submit(client.get, "/media/any.mp4")
        until(lambda: queue.count(RENDER) == (1, 0), "it was asked for again")
        asyncio.run(do_what_waits(tasks))
        assert again.result(PATIENCE_S).status_code == 307
    assert store.read(store.names()[0]) == b"a video"


def test_what_a_worker_cannot_do_at_all_is_no_store_that_is_away(
    app: AppContext, queue: TaskQueue, tasks: WorkerTasks
) -> None:
    unknown = app.background.in_process((RENDER, "env1/999/0"), print)
    until(lambda: queue.count(RENDER) == (1, 0), "it was asked for")
    asyncio.run(do_what_waits(tasks))
    assert isinstance(unknown.exception(PATIENCE_S), WorkerFailedError)
