"""The queue between servers and workers: asked once, moved up, counted, lost and found again."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from app.main import create_app
from app.services import jobs
from app.services.accounts.accounts import Principal
from app.services.background.remote import RemoteBackground
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.maintenance.worker_tasks import MOST_LOSSES, HeartbeatConfig, WorkerTasks
from app.services.recordings.recordings import make_video
from app.services.studies import repository, simulation_results
from app.storage import procrastinate_tables
from app.storage.database import Database
from app.storage.task_queue import JOB, RENDER, RETENTION, Task, TaskQueue
from tests.databases import PostgresServer

from .apart import TOKEN, app, queue, server, settings, somebody, study, video
from .client import Api
from .test_watched_by_machines import names_on_the_dashboard, words
from .workers import until

__all__ = ["app", "queue", "server", "settings", "somebody", "study"]

pytestmark = pytest.mark.postgresql


def test_several_servers_make_one_queue_and_another_versions_is_made_anew(
    server: PostgresServer,
) -> None:
    database = Database(server.empty("fresh"))
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: procrastinate_tables.prepare(database), range(4)))
    queue = TaskQueue(database)
    queue.enqueue(Task(RENDER, "env1/0/0"))
    procrastinate_tables.prepare(database)
    assert queue.count(RENDER) == (1, 0)
    with database.write() as db:
        db.execute(text("COMMENT ON SCHEMA procrastinate IS 'procrastinate 0.1'"))
    procrastinate_tables.prepare(database)
    assert queue.count(RENDER) == (0, 0)
    database.close()


def test_what_waits_is_asked_for_once_and_moved_up_for_who_waits(queue: TaskQueue) -> None:
    for name in ("a", "b"):
        queue.enqueue(Task(RENDER, name, priority=0))
    urgent = [queue.enqueue(Task(RENDER, "b", priority=priority)) for priority in (10, 0)]
    assert queue.count(RENDER) == (2, 0)
    assert len(set(urgent)) == 1
    with queue._database.read() as db:
        order = db.scalars(
            text(
                "SELECT args->>'argument' FROM procrastinate.procrastinate_jobs"
                " ORDER BY priority DESC, id"
            )
        ).all()
    assert order == ["b", "a"]


def test_asked_for_by_many_at_once_it_waits_once(queue: TaskQueue) -> None:
    with ThreadPoolExecutor(8) as pool:
        ids = set(pool.map(queue.enqueue, [Task(RENDER, "a")] * 24))
    assert len(ids) == 1


class TestLost:
    """Tasks whose worker was lost; as if one had taken them, and had not been heard of again."""

    @pytest.fixture
    def lose(self, app: AppContext) -> Callable[[], None]:
        def taken() -> None:
            with app.database.write() as db:
                db.execute(text("SET LOCAL search_path TO procrastinate"))
                db.execute(text("UPDATE procrastinate_jobs SET status = 'doing'"))

        return taken

    def test_each_loss_counts_once_whoever_looks_and_the_third_is_the_last(
        self, queue: TaskQueue, lose: Callable[[], None]
    ) -> None:
        asked = queue.enqueue(Task(RENDER, "a"))
        for number in (1, 2, 3):
            lose()
            with ThreadPoolExecutor(4) as pool:
                found = list(pool.map(lambda _: queue.requeue_stalled(8, 3), range(4)))
            (lost,) = [one for each in found for one in each]
            assert (lost.name, lost.argument, lost.times) == (RENDER, "a", number)
            assert lost.is_over == (number == 3)
        state = queue.states([asked])[asked]
        assert state.status == "failed"
        assert state.fault == "it was given up after 3 workers were lost at it"
        # Asked for again, it is tried again.
        assert queue.enqueue(Task(RENDER, "a")) != asked

    def test_what_was_taken_back_is_moved_up_as_well(
        self, queue: TaskQueue, app: AppContext, lose: Callable[[], None]
    ) -> None:
        asked = queue.enqueue(Task(RENDER, "a"))
        lose()
        queue.requeue_stalled(8, 3)
        with app.database.write() as db:
            # As a worker does that gives it back.
            db.execute(text("SET LOCAL search_path TO procrastinate"))
            db.execute(text("UPDATE procrastinate_jobs SET scheduled_at = now()"))
        assert queue.enqueue(Task(RENDER, "a", priority=10)) == asked

    def test_one_that_is_waited_for_again_already_is_not_waited_for_twice(
        self, queue: TaskQueue, lose: Callable[[], None], app: AppContext
    ) -> None:
        lost = queue.enqueue(Task(RETENTION, ""))
        lose()
        with app.database.write() as db:
            # As each full hour does.
            db.execute(text("SET LOCAL search_path TO procrastinate"))
            db.execute(
                text(
                    "SELECT procrastinate_defer_periodic_job_v2"
                    "('retention', 'retention:', 'retention:', 'retention', 0, '', 1, '{}')"
                )
            )
        queue.requeue_stalled(8, 3)
        assert queue.states([lost])[lost].status == "failed"
        assert queue.count(RETENTION) == (1, 0)

    def test_a_job_that_was_lost_too_often_says_so(
        self,
        app: AppContext,
        queue: TaskQueue,
        lose: Callable[[], None],
        somebody: Principal,
        study: repository.StudyInfo,
    ) -> None:
        asked = simulation_results.simulate(app, somebody, study, 2, "certain", 0)
        until(lambda: queue.count(JOB) == (1, 0), "it was asked for")
        tasks = WorkerTasks(app, queue, HeartbeatConfig())
        for _ in range(MOST_LOSSES):
            lose()
            tasks.requeue_stalled()
        told = jobs.status(app, somebody, asked.public_id)
        assert told.state == jobs.FAILED
        assert told.message == "it was given up after 3 workers were lost at it"
        tasks.stop()


def test_the_queue_is_one_for_all_servers_and_measured_once(app: AppContext) -> None:
    assert video(app, "env1/0/0") is video(app, "env1/0/0", urgent=True)
    video(app, "env1/1/0")
    other = open_app(app.settings)
    video(other, "env1/1/0", urgent=True)
    until(lambda: TaskQueue(app.database).count(RENDER) == (2, 0), "both were asked for")
    with Api(create_app(app=other)) as client:
        headers = {"Authorization": f"Bearer {TOKEN}"}
        client.get("/healthz")
        text = client.get("/metrics", headers=headers).text
    other.close()
    assert names_on_the_dashboard() <= set(words(text))
    told = text.splitlines()
    assert 'pbpo_render_queue{state="waiting"} 2.0' in told
    assert 'pbpo_render_queue{state="running"} 0.0' in told
    assert "pbpo_workers 0.0" in told
    assert told.count("# TYPE pbpo_render_queue gauge") == 1


def test_where_the_queue_cannot_be_reached_who_waits_is_told() -> None:
    nowhere = Database("postgresql+psycopg://nobody@127.0.0.1:1/none?connect_timeout=2")
    background = RemoteBackground(TaskQueue(nowhere))
    future = background.in_process((RENDER, "env1/0/0"), make_video, urgent=True)
    assert isinstance(future.exception(30), OperationalError)
    background.close()


def test_only_what_workers_can_do_is_asked_of_them(app: AppContext) -> None:
    with pytest.raises(TypeError, match="expected a video to be rendered"):
        app.background.in_process("anything", print)
    waiting = video(app, "env1/0/0")
    app.background.close()
    assert waiting.exception(1) is not None
