"""The application context: the components that every use case receives, built by `bootstrap`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime

from app.services.background.interface import Background
from app.services.background.job_function import JobHandler
from app.services.proposals.proposer import Proposer
from app.services.recordings.addresses import VideoAddresses
from app.services.recordings.recordings import Recordings
from app.services.runtime.known_hashes import KnownHashes
from app.services.runtime.metrics import Metrics
from app.services.runtime.settings import Settings
from app.storage.database import Database

from .deletion_log import DeletionLog
from .failure_counter import FailureCounter
from .platform_keys import PlatformKeys
from .server_secret import ServerSecret


def utc_now() -> datetime:
    """The present time in UTC."""
    return datetime.now(UTC)


@dataclass(frozen=True)
class AppContext:
    """The components of one process. Clock and random seeds are injected here, for tests."""

    settings: Settings
    database: Database
    background: Background
    recordings: Recordings
    proposer: Proposer
    metrics: Metrics
    #: Deletions that a restore must repeat.
    deletion_log: DeletionLog
    #: Root secret, from which the server's keys are derived.
    secret: ServerSecret
    #: Addresses of recordings within sessions.
    addresses: VideoAddresses
    #: Public keys that verify signed links of platforms.
    platform_keys: PlatformKeys
    now: Callable[[], datetime]
    seed: Callable[[], int]
    #: Counts failures during participation.
    failures: FailureCounter
    #: Handlers by kind of job.
    job_handlers: Mapping[str, JobHandler]
    #: Hashes of tokens of sessions that are not previews (see `arrival.preview_tokens`).
    other_tokens: KnownHashes = field(default_factory=KnownHashes)

    def close(self) -> None:
        """Stop background work, and close the database and the stores."""
        self.background.close()
        self.proposer.close()
        self.recordings.close()
        self.database.close()
