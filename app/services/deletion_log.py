"""Append-only log of deletions outside the database, by which a restore repeats them.

A restored backup contains data that was deleted after the backup was made. Each line has a day, the
kind of deletion, and a SHA-256 hash: of a session's token hash, or of a study's slug and creation
time. The log alone identifies nobody; together with a backup, it tells what to delete again.
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

#: Kinds: a session at the participant's wish; a session by the study's retention rule; ids of a
#: platform only; a whole study.
WISH = "wish"
RETENTION = "retention"
IDENTITIES = "identities"
STUDY = "study"

_LINE = re.compile(
    rf"(\d{{4}}-\d\d-\d\d) ({WISH}|{RETENTION}|{IDENTITIES}|{STUDY}) ([0-9a-f]{{64}})"
)

#: An incomplete line, as after a power cut.
_TORN = re.compile(r"\d{0,4}(-\d{0,2}){0,2}( [a-z]*)?( [0-9a-f]*)?")


@dataclass(frozen=True)
class Deleted:
    """One line of the log. what: kind of deletion. key: hash of what was deleted."""

    day: datetime
    what: str
    key: str


def session_key(token_hash: str) -> str:
    """The key of a session: a hash of its token hash, so that it differs from the stored one."""
    return hashlib.sha256(f"deleted session:{token_hash}".encode()).hexdigest()


def study_key(slug: str, created_at: datetime) -> str:
    """The key of a study. Its creation time tells it from a later study with the same slug."""
    return hashlib.sha256(f"deleted study:{slug}:{created_at.isoformat()}".encode()).hexdigest()


class DeletionLog:
    """Appends lines to one log file. Safe for concurrent processes."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def append(self, at: datetime, what: str, keys: Iterable[str]) -> None:
        """Append a line for each key, and flush them to disk.

        Call it before the deletion commits: a superfluous line only repeats a deletion that was
        intended, but a missing one would let a restore bring the data back.
        """
        text = "".join(f"{at.astimezone(UTC):%Y-%m-%d} {what} {key}\n" for key in keys)
        if not text:
            return
        descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
        with os.fdopen(descriptor, "r+b") as file:
            # Other processes may append at the same time.
            fcntl.flock(file, fcntl.LOCK_EX)
            end = file.seek(0, os.SEEK_END)
            if end and os.pread(descriptor, 1, end - 1) != b"\n":
                # The last line is incomplete after a power cut; its deletion was not committed.
                text = f"\n{text}"
            file.write(text.encode())
            file.flush()
            os.fsync(descriptor)


def merge(path: Path, lines: Iterable[Deleted]) -> list[Deleted]:
    """Append those lines that the log at `path` lacks, creating it if needed; returns all lines.

    Raises ConflictError if the file cannot be read or written.
    """
    try:
        known = dict.fromkeys(read(path) if path.exists() else ())
        lacking = [line for line in dict.fromkeys(lines) if line not in known]
        for line in lacking:
            DeletionLog(path).append(line.day, line.what, [line.key])
    except OSError as error:
        raise ConflictError(
            f"expected a ledger of deletions to read and write at {path}: {error.strerror}"
        ) from None
    return [*known, *lacking]


def read(path: Path) -> list[Deleted]:
    """The lines of a log; incomplete ones are skipped. Raises ConflictError for other files."""
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
