"""Counts server-side failures during participation, by study, kind and hour.

Counts are buffered in memory and written at most every few seconds by one thread, so that counting
neither slows requests down nor fails with them. Counts that cannot be written, because the database
is away, stay in the buffer.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import StrEnum

from sqlalchemy import Update, delete, select, update
from sqlalchemy.engine import CursorResult
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from app.services.runtime.ids import secret_hash
from app.storage.database import Database
from app.storage.models.arrivals import Reentry
from app.storage.models.records import FaultCount
from app.storage.models.studies import Candidate, Recording, SessionRow, Study

log = logging.getLogger(__name__)

#: How long counts are stored: longer than logs are usually searched for a cause.
KEPT = timedelta(days=30)
#: Shortest interval between two writes, in seconds.
_BETWEEN_S = 5.0
#: Entries in the buffer at the most: the database may be away for a long time.
_MOST_WAITING = 10_000


class Kind(StrEnum):
    """The kind of failure, as stored in the database."""

    PAGE = "page"
    CALL = "call"
    VIDEO = "video"
    DATABASE = "database"
    CROWDED = "crowded"
    RETENTION = "retention"
    EVENTS = "events"
    UNFILLED = "unfilled"
    UNREADABLE = "unreadable"


@dataclass(frozen=True)
class FailureContext:
    """Identifies the study in which a failure occurred, by the first of these that is not None."""

    slug: str | None = None
    session_hash: str | None = None
    recording: str | None = None
    session_id: int | None = None

    @classmethod
    def of(
        cls, slug: str | None, token: str | None, recording: str | None
    ) -> FailureContext | None:
        """A context from what a request contains; None if nothing identifies the study.

        Only the hash of the token is stored.
        """
        if slug is not None:
            return cls(slug=slug)
        if token is not None:
            return cls(session_hash=secret_hash(token))
        return cls(recording=recording) if recording is not None else None


@dataclass(frozen=True)
class _Fault:
    kind: Kind
    where: FailureContext
    hour: datetime


class FailureCounter:
    """The buffered counts of one process. Thread-safe."""

    def __init__(self, database: Database, now: Callable[[], datetime]) -> None:
        self._database = database
        self._now = now
        self._lock = threading.Lock()
        self._writing = threading.Lock()
        self._waiting: Counter[_Fault] = Counter()
        self._last: dict[_Fault, datetime] = {}
        self._not_before = 0.0

    def count(self, kind: Kind, where: FailureContext) -> None:
        """Count a failure now, and write the buffer if it is due. Never raises."""
        self.buffer(kind, where)
        if time.monotonic() >= self._not_before:
            self.write()

    def buffer(self, kind: Kind, where: FailureContext) -> None:
        """Count a failure in the buffer only, for callers that must not write to the database."""
        now = self._now()
        fault = _Fault(kind, where, now.replace(minute=0, second=0, microsecond=0))
        with self._lock:
            if fault in self._waiting or len(self._waiting) < _MOST_WAITING:
                self._waiting[fault] += 1
                self._last[fault] = now

    def write(self) -> None:
        """Write the buffer, unless another thread is writing it. Never raises."""
        if not self._waiting or not self._writing.acquire(blocking=False):
            return
        try:
            with self._lock:
                waiting, self._waiting = self._waiting, Counter()
                last, self._last = self._last, {}
            try:
                with self._database.write() as db:
                    for fault, number in waiting.items():
                        _add(db, fault, number, last[fault])
            except Exception:
                log.exception("faults could not be counted now, and will be later")
                with self._lock:
                    self._waiting.update(waiting)
                    self._last = {**last, **self._last}
        finally:
            self._not_before = time.monotonic() + _BETWEEN_S
            self._writing.release()

    def delete_old(self) -> int:
        """Delete the counts that are older than `KEPT`; returns their number."""
        self.write()
        with self._database.write() as db:
            result = db.execute(delete(FaultCount).where(FaultCount.hour <= self._now() - KEPT))
            assert isinstance(result, CursorResult)
            return result.rowcount


def _add(db: Session, fault: _Fault, number: int, last_at: datetime) -> None:
    study_id = _study_id(db, fault.where)
    if study_id is not None:
        add(db, study_id, fault.kind, number, last_at)


def add(db: Session, study_id: int, kind: Kind, number: int, last_at: datetime) -> None:
    """Add `number` failures to the hour of `last_at`, within the caller's transaction."""
    hour = last_at.replace(minute=0, second=0, microsecond=0)
    counted = (
        update(FaultCount)
        .where(
            FaultCount.study_id == study_id,
            FaultCount.kind == kind.value,
            FaultCount.hour == hour,
        )
        .values(number=FaultCount.number + number, last_at=last_at)
        .execution_options(synchronize_session=False)
    )
    if _changed(db, counted):
        return
    first = FaultCount(
        study_id=study_id, kind=kind.value, hour=hour, number=number, last_at=last_at
    )
    try:
        with db.begin_nested():
            db.add(first)
    except IntegrityError:
        # Another process has inserted the row of this hour meanwhile.
        _changed(db, counted)


def _changed(db: Session, statement: Update) -> bool:
    result = db.execute(statement)
    assert isinstance(result, CursorResult)
    return result.rowcount > 0


def _study_id(db: Session, where: FailureContext) -> int | None:
    """The study's primary key; None if there is no such study, or it was deleted."""
    if where.slug is not None:
        return db.scalar(select(Study.id).where(Study.slug == where.slug))
    if where.session_hash is not None:
        came_back = select(Reentry.session_id).where(Reentry.token_hash == where.session_hash)
        return db.scalar(
            select(SessionRow.study_id).where(
                (SessionRow.token_hash == where.session_hash) | SessionRow.id.in_(came_back)
            )
        )
    if where.session_id is not None:
        return db.scalar(select(SessionRow.study_id).where(SessionRow.id == where.session_id))
    return db.scalar(
        select(Candidate.study_id)
        .join(Recording, Recording.candidate_id == Candidate.id)
        .where(Recording.public_id == where.recording)
    )
