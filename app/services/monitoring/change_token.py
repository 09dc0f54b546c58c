"""A short token that changes whenever the data on a study's pages may have changed.

Every open page polls it about once a second, so it reads one index and a few rows.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import timedelta

from sqlalchemy import case, func, select

from app.services.context import AppContext
from app.storage.models.arrivals import Tombstone
from app.storage.models.consents import DeclinedCount
from app.storage.models.records import FaultCount
from app.storage.models.studies import SessionRow, Study


def change_token(app: AppContext, study_id: int, modes: Sequence[str], lease_minutes: int) -> str:
    """The token of a study's present state and its sessions in these modes: 16 hex digits."""
    heard_of_since = app.now() - timedelta(minutes=lease_minutes)
    of_study = SessionRow.study_id == study_id, SessionRow.mode.in_(modes)
    with app.database.read() as db:
        status = db.execute(
            select(Study.status, Study.paused_at, Study.conditions_off).where(Study.id == study_id)
        ).one_or_none()
        # The sums also change for a session that is not the most recently seen one.
        sessions = db.execute(
            select(
                SessionRow.stage,
                func.count(SessionRow.id),
                func.max(SessionRow.last_seen_at),
                func.sum(SessionRow.trial_index),
                func.sum(SessionRow.query_index),
                func.sum(case((SessionRow.last_seen_at >= heard_of_since, 1), else_=0)),
            )
            .where(*of_study)
            .group_by(SessionRow.stage)
            .order_by(SessionRow.stage)
        ).all()
        deleted = db.scalar(
            select(func.count(Tombstone.id)).where(
                Tombstone.study_id == study_id, Tombstone.mode.in_(modes)
            )
        )
        declined = db.scalar(
            select(func.sum(DeclinedCount.number)).where(DeclinedCount.study_id == study_id)
        )
        faults = db.execute(
            select(func.sum(FaultCount.number), func.max(FaultCount.last_at)).where(
                FaultCount.study_id == study_id
            )
        ).one()
    return hashlib.sha256(repr((status, sessions, deleted, declined, faults)).encode()).hexdigest()[
        :16
    ]
