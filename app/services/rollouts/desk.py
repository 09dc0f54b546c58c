"""The operator's desk: rollouts that a person records by hand.

The desk is a machine without a token: whoever may change the study takes a rollout there, sets the
values, records, and hands the video in, by the same functions as a machine.
"""

from __future__ import annotations

from datetime import timedelta
from typing import IO, Final

from sqlalchemy import select

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.storage.models.rollouts import Machine, Rollout

from . import acceptance, claims, machines, queue, reports, states, uploads
from .acceptance import Accepted
from .machines import DESK, MachineCaller
from .queue import RolloutLine
from .uploads import Part

#: How long a rollout that was taken at the desk is kept for it: a person sets it up by hand.
LEASE: Final = timedelta(hours=2)
_PIECE: Final = 1 << 20


def take(app: AppContext, study: StudyInfo) -> RolloutLine | None:
    """The rollout that the desk has, or else the next one, claimed; None without work."""
    taken = held(app, study)
    if taken is not None:
        return taken
    claims.claim(app, _desk(app, study), lease=LEASE)
    return held(app, study)


def held(app: AppContext, study: StudyInfo) -> RolloutLine | None:
    """The rollout that the desk has taken and not finished."""
    with app.database.read() as db:
        row = db.scalar(
            select(Rollout)
            .join(Machine, Rollout.machine_id == Machine.id)
            .where(
                Rollout.study_id == study.id,
                Rollout.status == states.CLAIMED,
                Machine.name == DESK,
                Rollout.lease_until > app.now(),
            )
            .order_by(Rollout.id)
        )
        return None if row is None else queue.line(row)


def hand_in(
    app: AppContext, study: StudyInfo, public_id: str, attempt: int, file: IO[bytes], size: int
) -> Accepted:
    """Take a video that was recorded at the desk.

    file: read from its start; size: its length in bytes. Raises NotFoundError, and
    RecordingRefusedError if it is no video that can be shown; the rollout then stays at the desk.
    """
    desk = _desk(app, study)
    if size == 0:
        raise ConflictError("expected a video, got an empty file")
    with uploads.begin(app, desk, public_id, attempt, Part(0, size)) as upload:
        for piece in iter(lambda: file.read(_PIECE), b""):
            upload.write(piece)
        return acceptance.finish(app, desk, public_id, attempt, upload, {})


def failed(
    app: AppContext, study: StudyInfo, public_id: str, reason: str, *, give_back: bool = False
) -> None:
    """The run failed, or (give_back) is left to others. Raises NotFoundError, LeaseLostError."""
    reports.failed(app, _desk(app, study), public_id, reason, give_back=give_back)


def unsafe(app: AppContext, study: StudyInfo, public_id: str, reason: str) -> None:
    """These values must not be run, ever. Raises NotFoundError or ConflictError."""
    reports.unsafe(app, _desk(app, study), public_id, reason)


def _desk(app: AppContext, study: StudyInfo) -> MachineCaller:
    with app.database.read() as db:
        row = db.scalar(select(Machine).where(Machine.study_id == study.id, Machine.name == DESK))
    if row is None:
        with app.database.write() as db:
            repository.lock_study(db, study.slug)
            row = machines.without_token(db, study.id, DESK, app.now())
    return MachineCaller(row.id, DESK, study.id, study.slug)
