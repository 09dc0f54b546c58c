"""Files of recordings: a study's own videos, and videos of the crane, rendered on demand.

Callers ask for a recording and get its file or a URL; only this module distinguishes the two
sources. The `stores` package decides whether files lie in folders or in an object store.
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

from cachetools import LRUCache, TTLCache
from sqlalchemy import bindparam, select

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

#: Cached sources of recordings: a video is requested in several ranges.
_MAX_SOURCES = 20_000

#: How long it is cached that a session exists, in seconds.
_SESSION_S = 60.0

#: Concurrent uploads to a store.
_AT_ONCE = 8

#: Cached, so that a process which renders many videos opens its store once.
_stores = lru_cache(maxsize=4)(open_stores)


class Source(Protocol):
    """The source of one recording: its kind (FILE or CRANE), and a locator in its format."""

    @property
    def source(self) -> str: ...

    @property
    def locator(self) -> str: ...


@dataclass(frozen=True)
class FoundSource:
    """A `Source` read from the database."""

    source: str
    locator: str


class Recordings:
    """Serves, renders, stores and deletes the files of recordings.

    Methods that access a store may raise StoreAwayError. Thread-safe.
    """

    def __init__(self, database: Database, background: Background, settings: Settings) -> None:
        self._database = database
        self._background = background
        self._settings = settings
        self._stores = open_stores(settings)
        self._find = lru_cache(_MAX_SOURCES)(self._find_uncached)
        #: Ids and seeds of sessions that exist, and sources by primary key.
        self._sessions: TTLCache[tuple[int, int], bool] = TTLCache(_MAX_SOURCES, _SESSION_S)
        self._by_id: LRUCache[int, Source] = LRUCache(_MAX_SOURCES)
        self._cache_lock = Lock()

    @property
    def origin(self) -> str | None:
        """Origin of the object store that browsers load videos from; None for this server."""
        return self._stores.own.origin

    def find(self, public_id: str) -> Source:
        """The source of the recording with this public id. Raises NotFoundError."""
        return self._find(public_id)

    def of_session(self, shown: AddressedRecording) -> Source:
        """The source of a session's recording. Raises GoneError if the session was deleted.

        That the session exists is cached for a minute. During that minute, the addresses of a
        session that another process has deleted remain valid here.
        """
        held = self.of_session_cached(shown)
        if held is not None:
            return held
        with self._database.read() as db:
            place = {"recording_id": shown.recording_id, "session_id": shown.session_id}
            row = db.execute(_SHOWN, place).one_or_none()
        if row is None or not is_of_session(shown, row.seed):
            raise GoneError("the session that was shown this video is deleted")
        found = FoundSource(row.source, row.locator)
        with self._cache_lock:
            self._sessions[shown.session_id, shown.seed] = True
            self._by_id[shown.recording_id] = found
        return found

    def of_session_cached(self, shown: AddressedRecording) -> Source | None:
        """The same, if it is cached; None if it has to be read. Makes no call to the database."""
        with self._cache_lock:
            # Only the session has to be known: the server made the address for a recording of the
            # session's study, and recordings never change.
            is_known = (shown.session_id, shown.seed) in self._sessions
            return self._by_id.get(shown.recording_id) if is_known else None

    def local_file(self, source: Source) -> Path | None:
        """The path of the file, there or not, if this server itself sends it from a folder."""
        store, name = self._kept(source)
        place = store.serve(name, head=False) if store.origin is None else None
        return place if isinstance(place, Path) else None

    def clear_session_cache(self) -> None:
        """Forget which sessions exist, so that deleted sessions are refused now."""
        with self._cache_lock:
            self._sessions.clear()

    def is_available(self, source: Source) -> bool:
        """Whether the file exists or can be rendered; True if unknown. Makes no network call."""
        store, name = self._kept(source)
        return source.source == CRANE or store.exists_cached(name) is not False

    def sizes(self, sources: Iterable[Source]) -> Mapping[str, int]:
        """Sizes in bytes of the files that exist, by locator; none of a store that is away."""
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
        """A future that is done when the recording's file exists; a missing one is rendered.

        urgent: put the rendering at the head of the queue. May make a network call: do not call it
        within a transaction. Raises NotFoundError immediately if a study's own file is missing.
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
        """How to answer a request for a file that `ensure` has provided.

        Returns a path to send, a signed URL to redirect to, or an internal redirect for the proxy.
        head: whether the request is a HEAD.
        """
        store, name = self._kept(source)
        return store.serve(name, head=head)

    def prefetch(self, source: Source) -> None:
        """Start to render a missing video in the background; `ensure` reports any error later."""
        if source.source != CRANE:
            return
        store, name = self._kept(source)
        match store.exists_cached(name):
            case None:
                # This needs a network call, and the caller may be within a transaction.
                self._background.in_thread(("there", name), self._make_missing, source)
            case False:
                self._make(source, urgent=False)

    @contextmanager
    def files(self, sources: Sequence[Source]) -> Iterator[list[Path]]:
        """Temporary copies of the files that exist, in order, deleted when the block ends."""
        with tempfile.TemporaryDirectory(prefix="pbpo-videos-") as folder:
            targets = [Path(folder) / str(number) for number in range(len(sources))]
            yield [
                target
                for source, target in zip(sources, targets, strict=True)
                if self.copy_to(source, target)
            ]

    def copy_to(self, source: Source, target: Path) -> bool:
        """Copy the recording's file to `target`. Returns False if there is no file."""
        store, name = self._kept(source)
        return store.copy_to(name, target)

    def keep_files(self, videos: Mapping[str, Path]) -> None:
        """Put studies' own videos into the store. videos: path by locator (see `file_locator`)."""
        _put_all(self._stores.own, videos)

    def delete(self, locators: Iterable[str]) -> None:
        """Delete studies' own videos by their locators. Tries all before raising StoreAwayError."""
        self._find.cache_clear()
        with self._cache_lock:
            self._by_id.clear()
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
        """Why recordings cannot be served, as a sentence; None if they can."""
        return self._stores.own.fault()

    def require_reachable(self) -> None:
        """Raise StoreAwayError if the store of studies' own videos is not reachable."""
        if fault := self.fault():
            raise StoreAwayError(fault)

    def close(self) -> None:
        """Close the connections of both stores."""
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


# Built once: for such a small query, building the statement takes as long as executing it.
_SHOWN = (
    select(Recording.source, Recording.locator, SessionRow.seed)
    .join(Candidate, Recording.candidate_id == Candidate.id)
    .join(SessionRow, SessionRow.study_id == Candidate.study_id)
    .where(Recording.id == bindparam("recording_id"), SessionRow.id == bindparam("session_id"))
)


def make_video(settings: Settings, locator: str) -> Path:
    """Render a crane recording's video unless it exists, and return its path. For any process.

    The video is written to the media folder and copied from there into the store if that is
    elsewhere. Raises StoreAwayError if either cannot be written to.
    """
    try:
        video = library.ensure_video(*_crane_run(locator), settings.media_dir)
        _stores(settings).rendered.put(video.name, video)
    except OSError as error:
        # For example, the folder is gone or the disk is full.
        raise StoreAwayError(f"the video could not be made: {error.strerror}") from error
    return video


def keep_rendered(settings: Settings, folder: Path) -> None:
    """Copy the rendered videos of a folder into the store for rendered videos."""
    _put_all(_stores(settings).rendered, {video.name: video for video in folder.glob("*.mp4")})


def video_url(name: str) -> str:
    """The URL path of a recording. name: its public id, or its address within a session."""
    return f"/media/{name}.mp4"


def file_locator(sha256: str, form: str) -> str:
    """The locator of a study's own video, which is also its name in every store.

    sha256: of the experimenter's original file. form: mp4 or webm, detected from the content.
    """
    return f"{sha256}.{form}"


def own_sha256(locator: str) -> str:
    """The SHA-256 of the original file that the locator of a study's own video contains."""
    return PurePosixPath(locator).stem


def _put_all(store: Store, files: Mapping[str, Path]) -> None:
    # In random order, because stores publish modification times, and these would reveal the order.
    names = sorted(files, key=lambda _name: secrets.token_bytes(8))
    with ThreadPoolExecutor(_AT_ONCE) as threads:
        # Consuming the results raises the first error.
        list(threads.map(store.put, names, (files[name] for name in names)))


def crane_locator(environment: str, candidate_index: int, run_index: int) -> str:
    """The locator of a run of the crane, such as `env1/12/0`."""
    return f"{environment}/{candidate_index}/{run_index}"


def _crane_run(locator: str) -> tuple[str, int, int]:
    environment, candidate_index, run_index = locator.split("/")
    return environment, int(candidate_index), int(run_index)


@lru_cache(maxsize=4096)
def _video_name(locator: str) -> str:
    return library.video_name(*_crane_run(locator))
