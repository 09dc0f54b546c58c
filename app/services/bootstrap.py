"""Builds the application context: opens the database, creates the components, registers jobs."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from types import MappingProxyType

from sqlalchemy import make_url
from threadpoolctl import threadpool_limits

from app.services.background.interface import Background
from app.services.background.job_function import JobHandler
from app.services.background.local import LocalBackground
from app.services.drafts import transcode_job
from app.services.ethics import bundle_job
from app.services.proposals.proposer import Proposer
from app.services.recordings.addresses import VideoAddresses
from app.services.recordings.recordings import Recordings
from app.services.runtime.errors import ConflictError
from app.services.runtime.ids import new_seed
from app.services.runtime.metrics import Metrics
from app.services.runtime.optional_packages import require_queue
from app.services.runtime.private_files import for_owner
from app.services.runtime.settings import Settings
from app.storage import dump_restore
from app.storage.database import Database
from app.storage.schema import bring_to_newest

from .context import AppContext, utc_now
from .deletion_log import DeletionLog
from .failure_counter import FailureCounter
from .platform_keys import PlatformKeys
from .server_secret import ServerSecret


def open_app(
    settings: Settings,
    *,
    now: Callable[[], datetime] = utc_now,
    seed: Callable[[], int] = new_seed,
    background: Background | None = None,
    restoring: bool = False,
    job_handlers: Mapping[str, JobHandler] = MappingProxyType({}),
) -> AppContext:
    """Build the context for these settings, and migrate the database to the newest schema.

    restoring: whether the caller is the restore that is in progress; all others are refused until
    it has finished. job_handlers: further kinds of jobs, defined outside the services.
    Raises ConflictError.
    """
    # One thread per fit: a fit takes milliseconds on one processor, and several times that if the
    # fits of all evaluators compete for all processors.
    threadpool_limits(1, user_api="blas")
    # Responses and identities are readable by the server's own user only.
    _make_folder(settings.data_dir, 0o700)
    _make_folder(settings.media_dir)
    if settings.own_videos_dir is not None:
        # The group may read it, so that a proxy can be given access.
        _make_folder(settings.own_videos_dir, 0o750)
    _make_database_file(settings)
    database = Database(settings.url)
    try:
        if not restoring:
            _require_whole(database)
        bring_to_newest(database)
        secret = ServerSecret(database)
        secret.ensure(now())
        if settings.workers_apart:
            background = _with_workers(database, background)
    except BaseException:
        database.close()
        raise
    background = background or LocalBackground(settings.render_jobs)
    metrics = Metrics(own_queue=not settings.workers_apart)
    background.observe_queue(metrics.renders)
    recordings = Recordings(database, background, settings)
    return AppContext(
        settings=settings,
        database=database,
        background=background,
        recordings=recordings,
        proposer=Proposer(database, background, recordings.prefetch, metrics),
        metrics=metrics,
        deletion_log=DeletionLog(settings.deletion_log_path),
        secret=secret,
        addresses=VideoAddresses(secret),
        platform_keys=PlatformKeys(settings.prolific_keys),
        now=now,
        failures=FailureCounter(database, now),
        seed=seed,
        job_handlers={
            **job_handlers,
            transcode_job.KIND: transcode_job.transcode_draft,
            bundle_job.KIND: bundle_job.make_bundle,
        },
    )


def _make_database_file(settings: Settings) -> None:
    """Create the SQLite file, private to its owner, unless it exists. Its WAL gets its mode."""
    url = make_url(settings.url)
    if url.get_backend_name() != "sqlite" or not url.database or Path(url.database).exists():
        return
    with suppress(OSError):  # opening the database reports the error
        os.close(for_owner(url.database, os.O_CREAT | os.O_WRONLY))


def _make_folder(folder: Path, mode: int = 0o777) -> None:
    """Create a folder unless it exists. Raises ConflictError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=mode)
    except OSError as error:
        raise ConflictError(
            f"expected a folder to write to, and {folder} cannot be made: {error.strerror}"
        ) from None


def _require_whole(database: Database) -> None:
    with database.engine.connect() as connection:
        try:
            dump_restore.require_whole(connection)
        except dump_restore.DumpError as error:
            raise ConflictError(str(error)) from None


def _with_workers(database: Database, background: Background | None) -> Background:
    """Create the task queue, and return `background` or, if None, a RemoteBackground."""
    require_queue()
    from app.services.background.remote import RemoteBackground  # noqa: PLC0415
    from app.storage import procrastinate_tables, task_queue  # noqa: PLC0415

    procrastinate_tables.prepare(database)
    return background or RemoteBackground(task_queue.TaskQueue(database))
