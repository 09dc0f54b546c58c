"""Recordings in a bucket of an S3-compatible store, which browsers get by links signed for a while.

What the store has is remembered for a while, so that a video which is asked for in several ranges,
by many people, is looked up once. Names are of content: what was there is there, or has gone.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from app.services.runtime.errors import StoreAwayError

from .interface import KEPT, Link, form_of
from .memory import Memory
from .s3_client import Bucket

#: For how long a link is good, in seconds: long enough to watch the longest video, and to be given
#: out again for half that time, so that a browser which comes back finds what it has kept.
LINK_S = 600
#: How long it is remembered that a file is there, and that one is not, in seconds.
THERE_S, MISSING_S = 600, 30
#: Above so many files that nothing is known of, the store is asked for its list.
_MOST_ASKED_ONE_BY_ONE = 8
#: How many files a store names in one answer.
PAGE = 1000


class S3Store:
    """A `Store` over one folder of a bucket."""

    def __init__(self, bucket: Bucket, folder: str) -> None:
        self._bucket = bucket
        self._folder = folder
        #: Bytes by name; None for what is missing.
        self._seen: Memory[str, int | None] = Memory()
        self._links: Memory[tuple[str, bool], str] = Memory()

    @property
    def origin(self) -> str | None:
        return self._bucket.origin

    def exists_cached(self, name: str) -> bool | None:
        seen = self._seen.find(name)
        return None if seen is None else seen[0] is not None

    def sizes(self, names: Iterable[str]) -> Mapping[str, int]:
        wanted = dict.fromkeys(names)
        unknown = [name for name in wanted if not self.exists_cached(name)]
        if len(unknown) > _MOST_ASKED_ONE_BY_ONE:
            for name, size in self._listed():
                self._seen.keep(name, size, THERE_S)
        else:
            for name in unknown:
                self._look(name)
        found = {name: seen[0] for name in wanted if (seen := self._seen.find(name))}
        return {name: size for name, size in found.items() if size is not None}

    def put(self, name: str, file: Path) -> None:
        # What is remembered does not count: another process may have thrown the file away. One of
        # another size is as an earlier version of this program made it.
        self._look(name)
        seen = self._seen.find(name)
        if seen is not None and seen[0] == file.stat().st_size:
            return
        with file.open("rb") as body:
            self._bucket.ask(
                "put_object", Key=self._key(name), Body=body, ContentType=form_of(name)
            )
        self._seen.keep(name, file.stat().st_size, THERE_S)

    def bring(self, name: str, target: Path) -> bool:
        answer = self._bucket.ask("get_object", Key=self._key(name))
        if answer is None:
            return False
        target.parent.mkdir(parents=True, exist_ok=True)
        with self._bucket.patiently(), target.open("wb") as file:
            shutil.copyfileobj(answer["Body"], file)
        return True

    def throw_away(self, names: Iterable[str]) -> None:
        # One by one: the call that deletes many differs between stores.
        for name in names:
            self._bucket.ask("delete_object", Key=self._key(name))
            self._seen.forget(name)

    def hand_out(self, name: str, *, head: bool) -> Link:
        """The link; nobody is sent there in the second half of its time."""
        half = LINK_S // 2
        if (held := self._links.find((name, head))) is not None:
            url, left = held
            return Link(url, int(left))
        url = self._bucket.sign(
            "head_object" if head else "get_object",
            self._key(name),
            LINK_S,
            ResponseContentType=form_of(name),
            ResponseCacheControl=KEPT,
        )
        self._links.keep((name, head), url, half)
        return Link(url, half)

    def fault(self) -> str | None:
        try:
            self._bucket.ask("list_objects_v2", Prefix=self._key(""), MaxKeys=1)
        except StoreAwayError as error:
            return f"{str(error)[:1].upper()}{str(error)[1:]}."
        return None

    def close(self) -> None:
        self._bucket.close()

    def _look(self, name: str) -> None:
        answer = self._bucket.ask("head_object", Key=self._key(name))
        if answer is None:
            self._seen.keep(name, None, MISSING_S)
        else:
            self._seen.keep(name, answer["ContentLength"], THERE_S)

    def _listed(self) -> Iterator[tuple[str, int]]:
        start = self._key("")
        words: dict[str, Any] = {"MaxKeys": PAGE}
        while True:
            answer = self._bucket.ask("list_objects_v2", Prefix=f"{start}/", **words)
            assert answer is not None  # a bucket that is missing is refused
            for one in answer.get("Contents", ()):
                yield one["Key"].removeprefix(f"{start}/"), one["Size"]
            if not answer.get("IsTruncated"):
                return
            words["ContinuationToken"] = answer["NextContinuationToken"]

    def _key(self, name: str) -> str:
        return self._bucket.key(self._folder, name)
