"""What has been worked out of trials, for several processes that serve the same people.

A browser's requests come to any of them: what one has worked out ahead, the others find. It lies in
a file of theirs, in a folder that only they can read and that goes when they end. Where the file
fails them, nothing is known ahead, and what is asked for is worked out then.
"""

from __future__ import annotations

import json
import logging
import pickle
import sqlite3
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Generic, TypeVar

from .foreseen import KEPT
from .thoughts import History

T = TypeVar("T")

#: How long one waits for another who writes, in seconds: each takes a millisecond.
PATIENCE_S = 2.0

log = logging.getLogger(__name__)

_TABLES = """
PRAGMA journal_mode = WAL;
PRAGMA synchronous = OFF;
PRAGMA secure_delete = ON;
PRAGMA foreign_keys = ON;
CREATE TABLE IF NOT EXISTS trials (
    seed INTEGER PRIMARY KEY, answers INTEGER NOT NULL, seen INTEGER NOT NULL UNIQUE
);
CREATE TABLE IF NOT EXISTS steps (
    seed INTEGER NOT NULL REFERENCES trials ON DELETE CASCADE,
    answers INTEGER NOT NULL,
    history TEXT NOT NULL,
    step BLOB NOT NULL,
    PRIMARY KEY (seed, answers, history)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS forgotten (seed INTEGER PRIMARY KEY);
"""
#: Unless its person had it deleted.
_BEGIN = """
INSERT INTO trials SELECT :seed, :answers, (SELECT coalesce(max(seen), 0) + 1 FROM trials)
WHERE NOT EXISTS (SELECT 1 FROM forgotten WHERE seed = :seed)
ON CONFLICT (seed) DO
"""
_SEEN = _BEGIN + "UPDATE SET answers = excluded.answers, seen = excluded.seen"
_KNOWN = _BEGIN + "NOTHING"
_STEP = """
INSERT OR REPLACE INTO steps SELECT :seed, :answers, :history, :step
WHERE EXISTS (SELECT 1 FROM trials WHERE seed = :seed)
"""
_TOO_MANY = """
DELETE FROM trials
WHERE seed IN (SELECT seed FROM trials ORDER BY seen DESC LIMIT -1 OFFSET :kept)
"""


class ForeseenTogether(Generic[T]):
    """As `Foreseen`, in a file that several processes have open."""

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        self._file = sqlite3.connect(
            path, timeout=PATIENCE_S, isolation_level=None, check_same_thread=False
        )
        self._file.executescript(_TABLES)

    def after(self, seed: int, histories: Sequence[History]) -> list[T | None]:
        """What follows each of these, as far as it is known."""
        lengths = sorted({len(history) for history in histories})
        known: dict[str, bytes] = {}
        with self._open() as file:
            for answers in lengths:
                known |= file.execute(
                    "SELECT history, step FROM steps WHERE seed = ? AND answers = ?",
                    (seed, answers),
                )
        found = [known.get(_text(history)) for history in histories]
        # Written by this program alone, as what it keeps in its memory is.
        return [None if step is None else pickle.loads(step) for step in found]  # noqa: S301

    def tell(self, seed: int, found: Mapping[History, T]) -> None:
        """Keep what follows these, all at once."""
        steps = [
            {"seed": seed, "answers": len(h), "history": _text(h), "step": pickle.dumps(step)}
            for h, step in found.items()
        ]
        with self._writing() as file:
            file.execute(_KNOWN, {"seed": seed, "answers": 0})
            file.executemany(_STEP, steps)

    def go_on(self, seed: int, answers: int) -> None:
        """The trial has come to so many answers: what follows fewer is not asked for again."""
        if self.stands_at(seed) == answers:
            return
        with self._writing() as file:
            file.execute(_SEEN, {"seed": seed, "answers": answers})
            file.execute("DELETE FROM steps WHERE seed = ? AND answers < ?", (seed, answers))
            file.execute(_TOO_MANY, {"kept": KEPT})

    def stands_at(self, seed: int) -> int | None:
        """How many answers the trial had when it was last seen."""
        found: list[tuple[int]] = []
        with self._open() as file:
            found += file.execute("SELECT answers FROM trials WHERE seed = ?", (seed,))
        return found[0][0] if found else None

    def seeds(self) -> frozenset[int]:
        """All trials that anything is kept of."""
        found: list[tuple[int]] = []
        with self._open() as file:
            found += file.execute("SELECT seed FROM trials")
        return frozenset(seed for (seed,) in found)

    def drop(self, seeds: frozenset[int]) -> None:
        """Throw away what is kept of these trials."""
        with self._writing() as file:
            file.executemany("DELETE FROM trials WHERE seed = ?", [(seed,) for seed in seeds])

    def forget(self, seeds: frozenset[int]) -> None:
        """The same, for good."""
        with self._writing() as file:
            each = [(seed,) for seed in seeds]
            file.executemany("INSERT OR IGNORE INTO forgotten VALUES (?)", each)
            file.executemany("DELETE FROM trials WHERE seed = ?", each)

    def close(self) -> None:
        with self._lock:
            self._file.close()

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """The file, for one thread; what cannot be read or written is done without."""
        try:
            with self._lock:
                yield self._file
        except sqlite3.Error as error:
            log.warning("what was worked out ahead cannot be kept or found: %s", error)

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """The same, for all of what is written or nothing."""
        with self._open() as file:
            file.execute("BEGIN IMMEDIATE")
            with file:
                yield file


def _text(history: History) -> str:
    return json.dumps(history)
