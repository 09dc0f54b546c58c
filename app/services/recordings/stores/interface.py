"""What a store of recordings can do, whichever it is.

Files are named by their content. So what lies under a name never changes, and whatever puts it
there twice puts the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

#: A file never changes under its name, and is nobody else's to see.
KEPT = "private, max-age=604800, immutable"


@dataclass(frozen=True)
class SignedUrl:
    """Where a browser gets a file itself, and for how many more seconds it may be sent there."""

    url: str
    seconds: int


@dataclass(frozen=True)
class InternalRedirect:
    """A file that the proxy in front sends in our place, by its address there."""

    address: str


def form_of(name: str) -> str:
    """The media type of a video, by its ending: those of studies' own say what they hold."""
    return "video/webm" if name.endswith(".webm") else "video/mp4"


class Store(Protocol):
    """Files by their names. Whatever asks a network raises StoreAwayError if it gets no answer."""

    @property
    def origin(self) -> str | None:
        """The site that browsers get files from, such as https://videos.example; None if ours."""

    def exists_cached(self, name: str) -> bool | None:
        """Whether the file is there, as far as that is known at once; None if it is not known."""

    def sizes(self, names: Iterable[str]) -> Mapping[str, int]:
        """Bytes of those files that are there. May ask a network."""

    def put(self, name: str, file: Path) -> None:
        """Keep a copy of the file under this name, unless there is one. May ask a network."""

    def copy_to(self, name: str, target: Path) -> bool:
        """Make `target` the file of this name; False if there is none. May ask a network."""

    def delete(self, names: Iterable[str]) -> None:
        """Delete files; those that are not there are none to delete. May ask a network."""

    def serve(self, name: str, *, head: bool) -> Path | SignedUrl | InternalRedirect:
        """How whoever asks gets the file, by a GET or, if `head`, by a HEAD. Asks no network."""

    def fault(self) -> str | None:
        """What keeps the store from working, in a sentence without a secret. May ask a network."""

    def close(self) -> None:
        """Let go of connections."""
