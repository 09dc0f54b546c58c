"""A store in a bucket of an S3-compatible object store; browsers load files by signed URLs.

The existence and size of files are cached for some minutes, because a video is requested in several
ranges and by many people.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from cachetools import TLRUCache, TTLCache

from app.services.runtime.errors import StoreAwayError

from .interface import KEPT, SignedUrl, form_of
from .s3_client import Bucket

#: Lifetime of a signed URL in seconds: long enough to watch the longest video. The same URL is
#: reused for the first half of that time, so that browsers can use their cached copy.
LINK_S = 600
#: How long the existence and the absence of a file are cached, in seconds.
THERE_S, MISSING_S = 600, 30
#: For more files than this that are not cached, the bucket is listed instead.
_MOST_ASKED_ONE_BY_ONE = 8
#: Cached entries at the most: twice as many as a large installation has recordings.
_MAX_CACHED: Final = 20_000
#: Files in one page of a listing.
PAGE = 1000


@dataclass(frozen=True)
class _Seen:
    """What the store last said of a file: its size in bytes, or None if it has no such file."""

    size: int | None


def _expires_at(_name: str, seen: _Seen, now: float) -> float:
    return now + (MISSING_S if seen.size is None else THERE_S)


class S3Store:
    """A `Store` over one folder of a bucket."""

    def __init__(self, bucket: Bucket, folder: str) -> None:
        self._bucket = bucket
        self._folder = folder
        self._seen: TLRUCache[str, _Seen] = TLRUCache(_MAX_CACHED, ttu=_expires_at)
        #: Signed URL and the time until which it is given out, by name and whether for a HEAD.
        self._links: TTLCache[tuple[str, bool], tuple[str, float]] = TTLCache(
            _MAX_CACHED, LINK_S // 2
        )
        self._lock = threading.Lock()

    @property
    def origin(self) -> str | None:
        return self._bucket.origin

    def exists_cached(self, name: str) -> bool | None:
        seen = self._cached(name)
        return None if seen is None else seen.size is not None

    def sizes(self, names: Iterable[str]) -> Mapping[str, int]:
        wanted = dict.fromkeys(names)
        unknown = [name for name in wanted if not self.exists_cached(name)]
        if len(unknown) > _MOST_ASKED_ONE_BY_ONE:
            for name, size in self._listed():
                self._remember(name, size)
        else:
            for name in unknown:
                self._head(name)
        found = {name: seen.size for name in wanted if (seen := self._cached(name))}
        return {name: size for name, size in found.items() if size is not None}

    def put(self, name: str, file: Path) -> None:
        # The cache is not trusted here: another process may have deleted the file. A file of
        # another size comes from an earlier version of this program and is replaced.
        self._head(name)
        seen = self._cached(name)
        if seen is not None and seen.size == file.stat().st_size:
            return
        with file.open("rb") as body:
            self._bucket.call(
                "put_object", Key=self._key(name), Body=body, ContentType=form_of(name)
            )
        self._remember(name, file.stat().st_size)

    def copy_to(self, name: str, target: Path) -> bool:
        answer = self._bucket.call("get_object", Key=self._key(name))
        if answer is None:
            return False
        target.parent.mkdir(parents=True, exist_ok=True)
        with self._bucket.errors_as_store_away(), target.open("wb") as file:
            shutil.copyfileobj(answer["Body"], file)
        return True

    def delete(self, names: Iterable[str]) -> None:
        # One request per file: stores differ in the call that deletes several.
        for name in names:
            self._bucket.call("delete_object", Key=self._key(name))
            with self._lock:
                self._seen.pop(name, None)

    def serve(self, name: str, *, head: bool) -> SignedUrl:
        """A signed URL, reused only during the first half of its lifetime."""
        with self._lock:
            cached = self._links.get((name, head))
        if cached is not None:
            url, until = cached
            return SignedUrl(url, int(max(0.0, until - time.monotonic())))
        url = self._bucket.sign(
            "head_object" if head else "get_object",
            self._key(name),
            LINK_S,
            ResponseContentType=form_of(name),
            ResponseCacheControl=KEPT,
        )
        with self._lock:
            self._links[name, head] = url, time.monotonic() + LINK_S // 2
        return SignedUrl(url, LINK_S // 2)

    def fault(self) -> str | None:
        try:
            self._bucket.call("list_objects_v2", Prefix=self._key(""), MaxKeys=1)
        except StoreAwayError as error:
            return f"{str(error)[:1].upper()}{str(error)[1:]}."
        return None

    def close(self) -> None:
        self._bucket.close()

    def _head(self, name: str) -> None:
        answer = self._bucket.call("head_object", Key=self._key(name))
        self._remember(name, None if answer is None else answer["ContentLength"])

    def _listed(self) -> Iterator[tuple[str, int]]:
        start = self._key("")
        words: dict[str, Any] = {"MaxKeys": PAGE}
        while True:
            answer = self._bucket.call("list_objects_v2", Prefix=f"{start}/", **words)
            assert answer is not None  # a missing bucket raises an error
            for one in answer.get("Contents", ()):
                yield one["Key"].removeprefix(f"{start}/"), one["Size"]
            if not answer.get("IsTruncated"):
                return
            words["ContinuationToken"] = answer["NextContinuationToken"]

    def _cached(self, name: str) -> _Seen | None:
        with self._lock:
            return self._seen.get(name)

    def _remember(self, name: str, size: int | None) -> None:
        with self._lock:
            self._seen[name] = _Seen(size)

    def _key(self, name: str) -> str:
        return self._bucket.key(self._folder, name)
