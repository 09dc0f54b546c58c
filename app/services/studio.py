"""The assembled studio: what every use case is handed."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType

from sqlalchemy import make_url
from threadpoolctl import threadpool_limits

from app.storage import dumps
from app.storage.database import Database
from app.storage.schema import bring_to_newest

from . import transcode_job
from .background import Background
from .errors import ConflictError
from .ethics import bundle_job
from .extras import require_queue
from .fault_counts import FaultCounts
from .in_process import InProcess
from .ledger import Ledger
from .measurements import Measurements
from .own_files import for_owner
from .platform_keys import PlatformKeys
from .proposals import Proposer
from .recordings import Recordings
from .server_secret import ServerSecret
from .settings import Settings
from .tokens import new_seed
from .video_addresses import VideoAddresses
from .work import Work


def utc_now() -> datetime:
    return datetime.now(UTC)


@dataclass(frozen=True)
class Studio:
    """Database, background work and settings. The clock and the seeds come in from here alone."""

    settings: Settings
    database: Database
    background: Background
    recordings: Recordings
    proposer: Proposer
    measurements: Measurements
    #: What a backup must not bring back.
    ledger: Ledger
    #: What keys of the server's own are derived from.
    secret: ServerSecret
    #: What a session knows a recording as.
    addresses: VideoAddresses
    #: What links that a platform signs are verified by.
    platform_keys: PlatformKeys
    now: Callable[[], datetime]
    seed: Callable[[], int]
    #: What failed while people took part, until it is written.
    faults: FaultCounts
    #: The function of each kind of job.
    works: Mapping[str, Work]

    def close(self) -> None:
        self.background.close()
        self.proposer.close()
        self.recordings.close()
        self.database.close()


def open_studio(
    settings: Settings,
    *,
    now: Callable[[], datetime] = utc_now,
    seed: Callable[[], int] = new_seed,
    background: Background | None = None,
    restoring: bool = False,
    works: Mapping[str, Work] = MappingProxyType({}),
) -> Studio:
    """Open the studio of `settings`, bringing its database to the newest schema.

    restoring: whether this is the restore that the database is under; others are refused until it
    is done. works: functions of further kinds of job, which services may not import.
    Raises ConflictError.
    """
    # A fit takes some milliseconds on one processor, and several times that if every fit of every
    # evaluator tries to have them all.
    threadpool_limits(1, user_api="blas")
    # What people answered, and who they are, is for the eyes of the server's own user.
    _make_folder(settings.data_dir, 0o700)
    _make_folder(settings.media_dir)
    if settings.own_videos_dir is not None:
        # Whoever else has to read it, such as a proxy, is let in by whoever runs the server.
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
    background = background or InProcess(settings.render_jobs)
    measurements = Measurements(own_queue=not settings.workers_apart)
    background.tell_queue(measurements.renders)
    recordings = Recordings(database, background, settings)
    return Studio(
        settings=settings,
        database=database,
        background=background,
        recordings=recordings,
        proposer=Proposer(database, background, recordings.make_soon, measurements),
        measurements=measurements,
        ledger=Ledger(settings.ledger_path),
        secret=secret,
        addresses=VideoAddresses(secret),
        platform_keys=PlatformKeys(settings.prolific_keys),
        now=now,
        faults=FaultCounts(database, now),
        seed=seed,
        works={
            **works,
            transcode_job.KIND: transcode_job.transcode_draft,
            bundle_job.KIND: bundle_job.make_bundle,
        },
    )


def _make_database_file(settings: Settings) -> None:
    """SQLite's file, if there is none: closed to others, as those that SQLite puts beside it."""
    url = make_url(settings.url)
    if url.get_backend_name() != "sqlite" or not url.database or Path(url.database).exists():
        return
    with suppress(OSError):  # said when the database is opened
        os.close(for_owner(url.database, os.O_CREAT | os.O_WRONLY))


def _make_folder(folder: Path, mode: int = 0o777) -> None:
    """Make it unless it is there. Raises ConflictError, as where a service may not write."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=mode)
    except OSError as error:
        raise ConflictError(
            f"expected a folder to write to, and {folder} cannot be made: {error.strerror}"
        ) from None


def _require_whole(database: Database) -> None:
    with database.engine.connect() as connection:
        try:
            dumps.require_whole(connection)
        except dumps.DumpError as error:
            raise ConflictError(str(error)) from None


def _with_workers(database: Database, background: Background | None) -> Background:
    """The door to workers, unless another one is given; their queue is there from now on."""
    require_queue()
    from app.storage import task_queue, task_tables  # noqa: PLC0415

    from .apart import Apart  # noqa: PLC0415

    task_tables.prepare(database)
    return background or Apart(task_queue.TaskQueue(database))
