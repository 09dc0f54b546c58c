"""Health checks of the server, and metrics that are read from the database."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from sqlalchemy import func, select
from sqlalchemy.exc import SQLAlchemyError

from app.services.context import AppContext
from app.services.rollouts import durations
from app.services.runtime.metrics import RENDER_QUEUE
from app.storage.models.studies import SessionRow
from app.storage.schema import newest_revision, revision_of

from . import clock


def faults(app: AppContext) -> list[str]:
    """Faults that keep the server from working: one sentence each, without addresses or secrets."""
    found = [_database_fault(app), app.recordings.fault()]
    found += [
        _folder_fault(name, folder)
        for name, folder in (
            ("data folder", app.settings.data_dir),
            ("folder of rendered videos", app.settings.media_dir),
            ("folder of studies' own videos", app.settings.own_videos_dir),
        )
        if folder is not None
    ]
    return [fault for fault in found if fault is not None]


def warnings(app: AppContext) -> list[str]:
    """Problems that do not affect participants, as sentences like those of `faults`."""
    try:
        queue, behind = app.background.queue(), clock.clock_lag(app)
        with app.database.read() as db:
            waiting = durations.unattended(db, app.now())
    except SQLAlchemyError:
        # `faults` reports this.
        return []
    found = []
    if queue is not None and queue.workers == 0:
        found.append("No worker is heard of: missing videos, jobs and retention wait for one.")
    if behind is not None:
        said = clock.lag_in_words(behind)
        found.append(f"The clock is {said} behind what was stored: it is wrong, or it was before.")
    away = sum(not study.is_stopped for study in waiting)
    if away:
        studies = "one study" if away == 1 else f"{away} studies"
        found.append(f"No machine of {studies} is heard of, and recordings wait for one.")
    if len(waiting) > away:
        number = len(waiting) - away
        studies = "one study" if number == 1 else f"{number} studies"
        found.append(f"The machines of {studies} are stopped, and recordings wait for them.")
    return found


def metrics(app: AppContext) -> bytes:
    """All metrics in Prometheus's text format: this server's, and those from the database."""
    registry = CollectorRegistry()
    registry.register(_InDatabase(app))
    return app.metrics.as_text() + generate_latest(registry)


class _InDatabase(Collector):
    """Gauges that are read from the database at each scrape.

    Ordinary gauges would be summed over the worker processes.
    """

    def __init__(self, app: AppContext) -> None:
        self._studio = app

    def collect(self) -> Iterator[GaugeMetricFamily]:
        sessions = GaugeMetricFamily(
            "pbpo_sessions", "Sessions that are kept, by stage.", labels=["mode", "stage"]
        )
        with self._studio.database.read() as db:
            counted = db.execute(
                select(SessionRow.mode, SessionRow.stage, func.count(SessionRow.id)).group_by(
                    SessionRow.mode, SessionRow.stage
                )
            )
            for mode, stage, number in counted:
                sessions.add_metric([mode, stage], number)
        yield sessions
        if (queue := self._studio.background.queue()) is None:
            return
        name, meaning, labels = RENDER_QUEUE
        renders = GaugeMetricFamily(name, meaning, labels=labels)
        renders.add_metric(["waiting"], queue.waiting)
        renders.add_metric(["running"], queue.running)
        yield renders
        yield GaugeMetricFamily(
            "pbpo_workers", "Workers that were heard of just now.", value=queue.workers
        )


def _database_fault(app: AppContext) -> str | None:
    try:
        with app.database.read() as db:
            revision = revision_of(db.connection())
    except SQLAlchemyError:
        # The database's own message may contain its address.
        return "The database cannot be reached."
    newest = newest_revision()
    if revision != newest:
        return f"The database is at schema {revision or 'none'}, and {newest} is expected."
    return None


def _folder_fault(name: str, folder: Path) -> str | None:
    try:
        # Write a byte, so that a full disk is detected as well.
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            file.write(b"\0")
    except OSError as error:
        return f"The {name} cannot be written to: {error.strerror}."
    return None
