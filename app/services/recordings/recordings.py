"""Where a recording's video comes from: a study's own file, or the crane, rendered when needed.

This is the one place that knows; the rest asks for a recording and gets a file, or a link to it.
Where files are kept, in folders or in a store of the network, is `stores`' to know.
"""

from __future__ import annotations

import logging
import secrets
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from threading import Lock
from typing import Any, Protocol

from cachetools import TTLCache
from sqlalchemy import select

from app.crane import library
from app.services.background.interface import Background
from app.services.recordings.stores.factory import open_stores
from app.services.recordings.stores.interface import InternalRedirect, SignedUrl, Store
from app.services.runtime.errors import GoneError, NotFoundError, StoreAwayError
from app.services.runtime.settings import Settings
from app.storage.database import Database
from app.storage.models.studies import Candidate, Recording, SessionRow

from .addresses import AddressedRecording, is_of_session

log = logging.getLogger(__name__)

FILE = "file"
CRANE = "crane"

#: How many recordings' sources are remembered: a video is asked for in several ranges.
_MAX_SOURCES = 20_000

#: For how long it is remembered what a session was shown, in seconds.
_SHOWN_S = 60.0

#: Videos that are put into a store at the same time.
_AT_ONCE = 8

#: A process that makes many videos opens its store once.
_stores = lru_cache(maxsize=4)(open_stores)


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
    """Hands out the files of recordings. Whatever asks a store may raise StoreAwayError."""

    def __init__(self, database: Database, background: Background, settings: Settings) -> None:
        self._database = database
        self._background = background
        self._settings = settings
        self._stores = open_stores(settings)
        self._find = lru_cache(_MAX_SOURCES)(self._find_uncached)
        self._shown: TTLCache[AddressedRecording, Source] = TTLCache(_MAX_SOURCES, _SHOWN_S)
        self._shown_lock = Lock()

    @property
    def origin(self) -> str | None:
        """The site that browsers get videos from; None where that is ours."""
        return self._stores.own.origin

    def find(self, public_id: str) -> Source:
        """The source of the recording that a browser knows as `public_id`, or NotFoundError."""
        return self._find(public_id)

    def of_session(self, shown: AddressedRecording) -> Source:
        """The source of what a session is shown. Raises GoneError once the session is deleted.

        What was found is remembered for a minute: for so long, addresses of a session that another
        process has deleted go on.
        """
        with self._shown_lock:
            held = self._shown.get(shown)
        if held is not None:
            return held
        with self._database.read() as db:
            row = db.execute(
                select(Recording.source, Recording.locator, SessionRow.seed)
                .join(Candidate, Recording.candidate_id == Candidate.id)
                .join(SessionRow, SessionRow.study_id == Candidate.study_id)
                .where(Recording.id == shown.recording_id, SessionRow.id == shown.session_id)
            ).one_or_none()
        if row is None or not is_of_session(shown, row.seed):
            raise GoneError("the session that was shown this video is deleted")
        found = FoundSource(row.source, row.locator)
        with self._shown_lock:
            self._shown[shown] = found
        return found

    def clear_session_cache(self) -> None:
        """Drop the cached sources of all sessions, so that deleted sessions are refused now."""
        with self._shown_lock:
            self._shown.clear()

    def is_available(self, source: Source) -> bool:
        """Whether there is a file, or one can be made, as far as is known. Asks no network."""
        store, name = self._kept(source)
        return source.source == CRANE or store.exists_cached(name) is not False

    def sizes(self, sources: Iterable[Source]) -> Mapping[str, int]:
        """Bytes of the files that are there, by locator; nothing while a store is away."""
        locators: dict[str, dict[str, str]] = {FILE: {}, CRANE: {}}
        for source in sources:
            locators[source.source][self._kept(source)[1]] = source.locator
        found: dict[str, int] = {}
        for kind, by_name in locators.items():
            try:
                held = self._store_of(kind).sizes(by_name)
            except StoreAwayError:
                continue
            found |= {by_name[name]: size for name, size in held.items()}
        return found

    def ensure(self, source: Source, *, urgent: bool = True) -> Future[Any]:
        """Done once the recording's file is there; a missing one is rendered in another process.

        It may ask a network: call it in no transaction. Raises NotFoundError, at once, if a study's
        own file has gone.
        """
        store, name = self._kept(source)
        if store.exists_cached(name) or store.sizes([name]):
            ready: Future[Any] = Future()
            ready.set_result(None)
            return ready
        if source.source == FILE:
            raise NotFoundError("the file of this recording is missing")
        return self._make(source, urgent=urgent)

    def serve(self, source: Source, *, head: bool = False) -> Path | SignedUrl | InternalRedirect:
        """How a browser gets the file that `ensure` saw to, by a GET or, if `head`, by a HEAD."""
        store, name = self._kept(source)
        return store.serve(name, head=head)

    def prefetch(self, source: Source) -> None:
        """Begin to make a video that will be asked for; a fault shows when it is."""
        if source.source != CRANE:
            return
        store, name = self._kept(source)
        match store.exists_cached(name):
            case None:
                # A store has to be asked, and whoever calls may be in the middle of a transaction.
                self._background.in_thread(("there", name), self._make_missing, source)
            case False:
                self._make(source, urgent=False)

    @contextmanager
    def files(self, sources: Sequence[Source]) -> Iterator[list[Path]]:
        """Copies of those files that are there, in their order, until the block ends."""
        with tempfile.TemporaryDirectory(prefix="pbpo-videos-") as folder:
            targets = [Path(folder) / str(number) for number in range(len(sources))]
            yield [
                target
                for source, target in zip(sources, targets, strict=True)
                if self.copy_to(source, target)
            ]

    def copy_to(self, source: Source, target: Path) -> bool:
        """Make `target` the recording's file; False if there is none."""
        store, name = self._kept(source)
        return store.copy_to(name, target)

    def keep_files(self, videos: Mapping[str, Path]) -> None:
        """Keep studies' own videos, each under the locator that `file_locator` gives."""
        _put_all(self._stores.own, videos)

    def delete(self, locators: Iterable[str]) -> None:
        """Delete videos of studies' own that no study has any more."""
        self._find.cache_clear()
        self.clear_session_cache()
        left = []
        for locator in locators:
            try:
                self._stores.own.delete([locator])
            except StoreAwayError:
                left.append(locator)
        if left:
            log.error("videos that no study has any more are still kept: %s", ", ".join(left))
            raise StoreAwayError(
                f"the study is deleted, but {len(left)} of its videos could not be: the server's"
                " log has their names"
            )

    def fault(self) -> str | None:
        """What keeps recordings from being handed out, in a sentence; None if nothing does."""
        return self._stores.own.fault()

    def require_reachable(self) -> None:
        """Raises StoreAwayError if recordings could not be deleted now."""
        if fault := self.fault():
            raise StoreAwayError(fault)

    def close(self) -> None:
        self._stores.own.close()
        self._stores.rendered.close()

    def _kept(self, source: Source) -> tuple[Store, str]:
        name = source.locator if source.source == FILE else _video_name(source.locator)
        return self._store_of(source.source), name

    def _store_of(self, kind: str) -> Store:
        return self._stores.own if kind == FILE else self._stores.rendered

    def _make_missing(self, source: Source) -> None:
        try:
            self.ensure(source, urgent=False)
        except StoreAwayError:
            log.warning("a video was not made ahead: the store of recordings is away")

    def _make(self, source: Source, *, urgent: bool) -> Future[Any]:
        return self._background.in_process(
            ("render", source.locator), make_video, self._settings, source.locator, urgent=urgent
        )

    def _find_uncached(self, public_id: str) -> Source:
        with self._database.read() as db:
            row = db.execute(
                select(Recording.source, Recording.locator).where(Recording.public_id == public_id)
            ).one_or_none()
        if row is None:
            raise NotFoundError("there is no such recording")
        return FoundSource(row.source, row.locator)


def make_video(settings: Settings, locator: str) -> Path:
    """Make the video of a crane's recording where it is missing, in any process: its file.

    It is made in the media folder, and put from there into the store, where that is another place.
    Raises StoreAwayError where either does not take it.
    """
    try:
        video = library.ensure_video(*_crane_run(locator), settings.media_dir)
        _stores(settings).rendered.put(video.name, video)
    except OSError as error:
        # The folder went away, say, or the disk is full.
        raise StoreAwayError(f"the video could not be made: {error.strerror}") from error
    return video


def keep_rendered(settings: Settings, folder: Path) -> None:
    """Put the rendered videos of a folder where the settings keep such videos."""
    _put_all(_stores(settings).rendered, {video.name: video for video in folder.glob("*.mp4")})


def video_url(name: str) -> str:
    """The address of a recording: by its public id, or by a name that one session knows it as."""
    return f"/media/{name}.mp4"


def file_locator(sha256: str, form: str) -> str:
    """What a study's own video is called wherever it is kept.

    sha256: of the experimenter's own file. form: mp4 or webm, as the content is and not as its
    name says.
    """
    return f"{sha256}.{form}"


def own_sha256(locator: str) -> str:
    """The SHA-256 of the experimenter's own file, of the locator of a study's own video."""
    return PurePosixPath(locator).stem


def _put_all(store: Store, files: Mapping[str, Path]) -> None:
    # In no order that says anything: a store tells everybody when it was given a file.
    names = sorted(files, key=lambda _name: secrets.token_bytes(8))
    with ThreadPoolExecutor(_AT_ONCE) as threads:
        # Whatever goes wrong with one of them is raised here.
        list(threads.map(store.put, names, (files[name] for name in names)))


def crane_locator(environment: str, candidate_index: int, run_index: int) -> str:
    return f"{environment}/{candidate_index}/{run_index}"


def _crane_run(locator: str) -> tuple[str, int, int]:
    environment, candidate_index, run_index = locator.split("/")
    return environment, int(candidate_index), int(run_index)


@lru_cache(maxsize=4096)
def _video_name(locator: str) -> str:
    return library.video_name(*_crane_run(locator))
