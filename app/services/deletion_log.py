"""The ledger of deletions: what a backup that was made before must not bring back.

It is a file beside the database, since a restored database knows nothing of what came after it. A
line is a day, what was deleted, and a hash: of a session's 256-bit token as the database hashes it,
or of a study's name and its moment. Who has only the ledger learns nothing of anybody from it; who
has a backup finds in it whom to delete again.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.services.runtime.errors import ConflictError

#: At the person's wish; by the study's rule; the ids of a platform alone; a study with everything.
WISH = "wish"
RETENTION = "retention"
IDENTITIES = "identities"
STUDY = "study"

_LINE = re.compile(
    rf"(\d{{4}}-\d\d-\d\d) ({WISH}|{RETENTION}|{IDENTITIES}|{STUDY}) ([0-9a-f]{{64}})"
)

#: What a power cut can leave of a line.
_TORN = re.compile(r"\d{0,4}(-\d{0,2}){0,2}( [a-z]*)?( [0-9a-f]*)?")


@dataclass(frozen=True)
class Deleted:
    """One line: what was deleted, on which day."""

    day: datetime
    what: str
    key: str


def session_key(token_hash: str) -> str:
    """What stands for a session. The database's own hash would let the ledger be matched by it."""
    return hashlib.sha256(f"deleted session:{token_hash}".encode()).hexdigest()


def study_key(slug: str, created_at: datetime) -> str:
    """What stands for a study: a later one of the same name is another one."""
    return hashlib.sha256(f"deleted study:{slug}:{created_at.isoformat()}".encode()).hexdigest()


class DeletionLog:
    """One file of deletions, only ever added to."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def note(self, at: datetime, what: str, keys: Iterable[str]) -> None:
        """Add lines; they are on the disk when this returns. Call it before the deletion commits:
        a line too many deletes again what somebody wanted deleted, a line too few brings it back.
        """
        text = "".join(f"{at.astimezone(UTC):%Y-%m-%d} {what} {key}\n" for key in keys)
        if not text:
            return
        descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
        with os.fdopen(descriptor, "r+b") as file:
            # Several processes may delete at once.
            fcntl.flock(file, fcntl.LOCK_EX)
            end = file.seek(0, os.SEEK_END)
            if end and os.pread(descriptor, 1, end - 1) != b"\n":
                # A power cut left half a line, of a deletion that did not come about.
                text = f"\n{text}"
            file.write(text.encode())
            file.flush()
            os.fsync(descriptor)


def merge(path: Path, lines: Iterable[Deleted]) -> list[Deleted]:
    """Add to the ledger at `path`, which need not be there yet, what it lacks; all its lines.

    Raises ConflictError if it cannot be read or written.
    """
    try:
        known = dict.fromkeys(read(path) if path.exists() else ())
        lacking = [line for line in dict.fromkeys(lines) if line not in known]
        for line in lacking:
            DeletionLog(path).note(line.day, line.what, [line.key])
    except OSError as error:
        raise ConflictError(
            f"expected a ledger of deletions to read and write at {path}: {error.strerror}"
        ) from None
    return [*known, *lacking]


def read(path: Path) -> list[Deleted]:
    """The lines of a ledger; half a line is passed over. Raises ConflictError for another file."""
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except FileNotFoundError:
        raise ConflictError(
            f"expected a ledger of deletions at {path}, and there is none"
        ) from None
    except UnicodeDecodeError:
        raise ConflictError(f"expected a ledger of deletions, and {path} is none") from None
    found = []
    for number, line in enumerate(lines, 1):
        match = _LINE.fullmatch(line)
        if match is not None:
            day = datetime.strptime(match[1], "%Y-%m-%d").replace(tzinfo=UTC)
            found.append(Deleted(day, match[2], match[3]))
        elif _TORN.fullmatch(line) is None:
            raise ConflictError(
                f"{path}:{number}: expected a day, what was deleted and a hash, got {line[:80]!r}"
            )
    return found
