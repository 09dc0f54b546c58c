"""Partial uploads of recordings: files that grow, and are continued where they were cut off.

The file of an upload is named by rollout, machine, attempt and length, so that parts of two runs
never mix. Each process of one server continues what another has begun; another server begins anew,
and says so by the number of bytes that it has.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from sqlalchemy import select

from app.services.context import AppContext
from app.services.runtime import disk_quota
from app.services.runtime.errors import (
    NoRoomError,
    NotFoundError,
    RecordingRefusedError,
    RecordingTooLargeError,
    StoreAwayError,
    UploadOffsetError,
)
from app.services.runtime.ids import new_public_id
from app.storage.models.rollouts import Rollout

from .machines import MachineCaller

FOLDER: Final = "rollouts"
#: How long a partial upload is kept after its last byte.
KEPT: Final = timedelta(days=1)
_ENDINGS: Final = (".part", ".whole")


@dataclass(frozen=True)
class Part:
    """Where the body of a request belongs in its recording.

    first: position of its first byte. total: length of the whole recording in bytes; None if the
    request is the whole and does not say how long it is.
    """

    first: int
    total: int | None


class Upload:
    """An open partial upload; `write` appends to it. Use it as a context manager.

    received: bytes from the start of the recording that have arrived without a gap.
    """

    def __init__(self, path: Path, part: Part, limit: int) -> None:
        self.path = path
        self.total = part.total
        self._limit = limit
        self._position = part.first
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._file = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._file)

    @property
    def received(self) -> int:
        return os.fstat(self._file).st_size

    @property
    def is_whole(self) -> bool:
        """Whether all bytes have arrived."""
        return self.total is not None and self.received >= self.total

    def write(self, data: bytes) -> None:
        """Append the next bytes of the request.

        Raises RecordingRefusedError for more bytes than were announced, RecordingTooLargeError, or
        StoreAwayError if the disk refuses them.
        """
        end = self._position + len(data)
        if end > self._limit:
            raise RecordingTooLargeError(_too_large(self._limit))
        if self.total is not None and end > self.total:
            raise RecordingRefusedError(f"expected {self.total:,} bytes in all, and more came")
        try:
            # At its own position: a connection that hangs and the one that continues it write the
            # same bytes to the same places.
            written = 0
            while written < len(data):
                written += os.pwrite(self._file, data[written:], self._position + written)
        except OSError as error:
            raise StoreAwayError(f"the recording cannot be kept: {error.strerror}") from error
        self._position = end

    def end_of_unknown_length(self) -> None:
        """The request is over: what came is the whole, if it did not say how long it is."""
        if self.total is None:
            self.total = self._position

    def force_to_disk(self) -> None:
        """Flush the file, so that its bytes survive a power cut."""
        os.fsync(self._file)


def begin(
    app: AppContext, caller: MachineCaller, public_id: str, attempt: int | None, part: Part
) -> Upload:
    """Open the partial upload that this part continues, or begin one.

    attempt: of the claim; None if the machine does not say. Raises NotFoundError for an unknown
    rollout, RecordingTooLargeError, UploadOffsetError if bytes before the part are missing, and
    StoreAwayError if the disk has too little space.
    """
    with app.database.read() as db:
        found = db.scalar(
            select(Rollout.public_id).where(
                Rollout.study_id == caller.study_id, Rollout.public_id == public_id
            )
        )
    if found is None:
        raise NotFoundError("there is no such rollout in this study")
    limit = app.settings.recording_limit_mb * 1_000_000
    if (part.total or 0) > limit:
        raise RecordingTooLargeError(_too_large(limit))
    folder = app.settings.uploads_dir / FOLDER
    try:
        disk_quota.require(app.settings, folder, max((part.total or 0) - part.first, 0))
    except NoRoomError as error:
        # A machine tries again later; only people could make room.
        raise StoreAwayError(str(error)) from None
    path = folder / _name(found, caller, attempt, part.total)
    try:
        upload = Upload(path, part, limit)
    except OSError as error:
        raise StoreAwayError(f"the recording cannot be kept: {error.strerror}") from error
    if part.first > upload.received:
        with upload:
            received = upload.received
        raise UploadOffsetError(
            f"expected bytes from {received:,} on, got some from {part.first:,} on", received
        )
    return upload


def _too_large(limit: int) -> str:
    """The refusal of a recording of more than `limit` bytes."""
    return f"expected a recording of at most {limit / 1e6:,.0f} MB, and this one is larger"


def delete_old(app: AppContext, stop: Callable[[], bool] = lambda: False) -> int:
    """Delete partial uploads that nobody continued for a day; return their number."""
    before = (app.now() - KEPT).timestamp()
    gone = 0
    for path in (app.settings.uploads_dir / FOLDER).glob("*.*"):
        if stop():
            break
        try:
            if path.suffix in _ENDINGS and path.stat().st_mtime <= before:
                path.unlink()
                gone += 1
        except FileNotFoundError:
            continue  # continued or deleted meanwhile
    return gone


def _name(public_id: str, caller: MachineCaller, attempt: int | None, total: int | None) -> str:
    length = f"once-{new_public_id()}" if total is None else str(total)
    return f"{public_id}-{caller.machine_id}-{attempt or 'any'}-{length}.part"
