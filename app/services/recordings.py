"""Where a recording's video comes from: a study's own file, or the crane, rendered when needed.

This is the one place that knows; the rest asks for a recording and gets a file.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol

from sqlalchemy import select

from app.crane import library
from app.storage.database import Database
from app.storage.tables import Recording

from .background import Background
from .errors import NotFoundError
from .settings import Settings

FILE = "file"
CRANE = "crane"

#: How many recordings' sources are remembered: a video is asked for in several ranges.
_KNOWN_SOURCES = 20_000


class Source(Protocol):
    """Where one recording comes from; `locator` is read by its kind of source."""

    @property
    def source(self) -> str: ...

    @property
    def locator(self) -> str: ...


@dataclass(frozen=True)
class FoundSource:
    source: str
    locator: str


class Recordings:
    """Hands out the files of recordings."""

    def __init__(self, database: Database, background: Background, settings: Settings) -> None:
        self._database = database
        self._background = background
        self._settings = settings
        self._uploads_dir = settings.uploads_dir
        self._media_dir = settings.media_dir
        self._find = lru_cache(_KNOWN_SOURCES)(self._find_uncached)

    def find(self, public_id: str) -> Source:
        """The source of the recording that a browser knows as `public_id`, or NotFoundError."""
        return self._find(public_id)

    def ready_path(self, source: Source) -> Path | None:
        """The recording's file if it is there already, else None."""
        path = (
            self._uploads_dir / source.locator
            if source.source == FILE
            else self._media_dir / _video_name(source.locator)
        )
        return path if path.is_file() else None

    def can_be_had(self, source: Source) -> bool:
        """Whether there is a file, or one can be made."""
        return source.source == CRANE or self.ready_path(source) is not None

    def ensure(self, source: Source, *, urgent: bool = True) -> Future[Path]:
        """A future of the recording's file; a missing one is rendered in a process of its own.

        Raises NotFoundError, at once, if a study's own file has gone.
        """
        path = self.ready_path(source)
        if path is not None:
            ready: Future[Path] = Future()
            ready.set_result(path)
            return ready
        if source.source == FILE:
            raise NotFoundError("the file of this recording is missing from the data folder")
        return self._background.in_process(
            ("render", source.locator),
            make_video,
            self._settings,
            source.locator,
            urgent=urgent,
        )

    def make_soon(self, source: Source) -> None:
        """Begin to make a video that will be asked for; a fault shows when it is."""
        if source.source == CRANE and self.ready_path(source) is None:
            self.ensure(source, urgent=False)

    def keep_file(self, video: Path, sha256: str) -> str:
        """Copy a study's own video into the data folder under its content's name: its locator."""
        locator = f"{sha256}{video.suffix.lower()}"
        target = self._uploads_dir / locator
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            part = target.with_name(f"{target.name}.{os.getpid()}.part")
            shutil.copyfile(video, part)
            part.replace(target)
        return locator

    def throw_away(self, locators: Iterable[str]) -> None:
        """Delete videos of studies' own that no study has any more."""
        for locator in locators:
            (self._uploads_dir / locator).unlink(missing_ok=True)
        self._find.cache_clear()

    def _find_uncached(self, public_id: str) -> Source:
        with self._database.read() as session:
            row = session.execute(
                select(Recording.source, Recording.locator).where(Recording.public_id == public_id)
            ).one_or_none()
        if row is None:
            raise NotFoundError("there is no such recording")
        return FoundSource(row.source, row.locator)


def make_video(settings: Settings, locator: str) -> Path:
    """Make the video of a crane's recording where it is missing, in any process: its file."""
    return library.ensure_video(*_crane_run(locator), settings.media_dir)


def crane_locator(environment: str, candidate_index: int, run_index: int) -> str:
    return f"{environment}/{candidate_index}/{run_index}"


def _crane_run(locator: str) -> tuple[str, int, int]:
    environment, candidate_index, run_index = locator.split("/")
    return environment, int(candidate_index), int(run_index)


@lru_cache(maxsize=4096)
def _video_name(locator: str) -> str:
    return library.video_name(*_crane_run(locator))
