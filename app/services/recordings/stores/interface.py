"""The interface of the stores of recordings.

Files are named by the hash of their content. A stored file therefore never changes, and writing a
name twice writes the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

#: Cache-Control of a recording: immutable, and cached by the browser only.
KEPT = "private, max-age=604800, immutable"


@dataclass(frozen=True)
class SignedUrl:
    """A signed URL of the file. seconds: how long the redirect to it may be cached."""

    url: str
    seconds: int


@dataclass(frozen=True)
class InternalRedirect:
    """A file that the proxy sends (X-Accel-Redirect). address: its internal path at the proxy."""

    address: str


def form_of(name: str) -> str:
    """The media type of a video, by the extension of its name."""
    return "video/webm" if name.endswith(".webm") else "video/mp4"


class Store(Protocol):
    """Files by name. Methods that make network calls raise StoreAwayError if those fail."""

    @property
    def origin(self) -> str | None:
        """Origin that browsers load files from, such as https://s3.example; None: this server."""

    def exists_cached(self, name: str) -> bool | None:
        """Whether the file exists, without a network call; None if that is unknown."""

    def sizes(self, names: Iterable[str]) -> Mapping[str, int]:
        """Sizes in bytes of those files that exist. May make network calls."""

    def put(self, name: str, file: Path) -> None:
        """Store a copy of the file under this name unless it exists. May make network calls."""

    def copy_to(self, name: str, target: Path) -> bool:
        """Copy the file to `target`. Returns False if it is missing. May make network calls."""

    def delete(self, names: Iterable[str]) -> None:
        """Delete files; missing ones are ignored. May make network calls."""

    def serve(self, name: str, *, head: bool) -> Path | SignedUrl | InternalRedirect:
        """How to answer a GET (or HEAD, if `head`) for the file. Makes no network call."""

    def fault(self) -> str | None:
        """Why the store does not work, as a sentence without secrets. May make network calls."""

    def close(self) -> None:
        """Close connections."""
