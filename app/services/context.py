"""The application context: the parts every use case is given, made once by `bootstrap`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from app.services.background.interface import Background
from app.services.background.job_function import JobHandler
from app.services.platform_keys import PlatformKeys
from app.services.proposals.proposer import Proposer
from app.services.recordings.addresses import VideoAddresses
from app.services.recordings.recordings import Recordings
from app.services.runtime.metrics import Metrics
from app.services.runtime.settings import Settings
from app.storage.database import Database

from .deletion_log import DeletionLog
from .failure_counter import FailureCounter
from .server_secret import ServerSecret


def utc_now() -> datetime:
    return datetime.now(UTC)


@dataclass(frozen=True)
class AppContext:
    """Database, background work and settings. The clock and the seeds come in from here alone."""

    settings: Settings
    database: Database
    background: Background
    recordings: Recordings
    proposer: Proposer
    metrics: Metrics
    #: What a backup must not bring back.
    deletion_log: DeletionLog
    #: What keys of the server's own are derived from.
    secret: ServerSecret
    #: What a session knows a recording as.
    addresses: VideoAddresses
    #: What links that a platform signs are verified by.
    platform_keys: PlatformKeys
    now: Callable[[], datetime]
    seed: Callable[[], int]
    #: What failed while people took part, until it is written.
    failures: FailureCounter
    #: The function of each kind of job.
    job_handlers: Mapping[str, JobHandler]

    def close(self) -> None:
        self.background.close()
        self.proposer.close()
        self.recordings.close()
        self.database.close()
