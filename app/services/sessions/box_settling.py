"""Looks at what became of the rollouts that an open query waits for.

Machines do not notify sessions. Whenever a session is looked at, recordings that exist by now are
bound to its open query, and a query that waits in vain is set aside and proposed anew. No process
has to stay alive for that.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from enum import Enum
from typing import Final

from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session, aliased

from app.services.context import AppContext
from app.services.rollouts import states
from app.services.studies.repository import stored_plan
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import QueryRow, SessionRow
from app.study.stages import Stage

from . import box_next, box_queries, box_trials, candidate_rows, lookup, queries
from .box_next import Computed
from .box_trials import BoxTrial
from .queries import OpenQuery

#: How often a query is looked at again in one call, because something changed meanwhile.
MOST_ROUNDS: Final = 8


class Outlook(Enum):
    """What is to be done about an open query."""

    NOTHING = "nothing"
    BIND = "bind"
    REPLACE = "replace"


def is_over_space(session: SessionRow) -> bool:
    """Whether the session's open query is one over a search space given by ranges."""
    return session.stage == Stage.QUERY and stored_plan(session.plan).has_ranges


def settle(app: AppContext, token: str) -> None:
    """Bind recordings that exist by now to the open query, or replace a query that waits in vain.

    Changes nothing if the session has no open query over a search space. Proposals are computed
    outside transactions. Raises the errors of `lookup.find`, and NothingToShowError.
    """
    for _ in range(MOST_ROUNDS):
        with app.database.read() as db:
            session = lookup.find(app, db, token)
            if not is_over_space(session):
                return
            query = queries.load_open_query(db, session, session.trial_index)
            outlook = _outlook(db, query.public_id)
            if outlook is Outlook.NOTHING:
                return
            trial = _trial(session, query)
            following = None
            if outlook is Outlook.REPLACE:
                following = box_queries.read_following(db, trial, query.trial_id, query.record)
        computed = None
        if following is not None:
            computed = box_next.compute(app.proposer.boxes, following)
        with app.database.write() as db:
            session = lookup.find(app, db, token, to_write=True)
            if not is_over_space(session):
                return
            current = queries.load_open_query(db, session, session.trial_index)
            if current.public_id != query.public_id or _outlook(db, query.public_id) != outlook:
                # Something changed meanwhile: look again.
                continue
            if computed is None:
                _bind(db, query.public_id, app.now())
            elif following == box_queries.read_following(
                db, trial, current.trial_id, current.record
            ):
                _replace(db, trial, current, computed, app.now())


def _trial(session: SessionRow, query: OpenQuery) -> BoxTrial:
    spec = queries.trial_spec(session, query.trial_index, query.seed, query.asked.engine_version)
    trial = box_trials.trial_of(session, spec)
    assert trial is not None
    return trial


def _outlook(db: Session, public_id: str) -> Outlook:
    sides = _sides(db, public_id)
    if any(status in states.LOST for _, status, _ in sides):
        return Outlook.REPLACE
    if any(bound is None and made is not None for bound, _, made in sides):
        return Outlook.BIND
    return Outlook.NOTHING


def _sides(db: Session, public_id: str) -> Sequence[tuple[int | None, str, int | None]]:
    """Of each side: the recording that is bound, the rollout's status, and its recording."""
    row = db.execute(_SIDES, {"public_id": public_id}).one()
    left, status_left, made_left, right, status_right, made_right = row
    return (left, status_left, made_left), (right, status_right, made_right)


def _bind(db: Session, public_id: str, now: datetime) -> None:
    """Bind the recordings that exist; the query is shown from the moment that both do."""
    row = db.scalars(select(QueryRow).where(QueryRow.public_id == public_id)).one()
    (left, _, made_left), (right, _, made_right) = _sides(db, public_id)
    row.left_recording_id = left if left is not None else made_left
    row.right_recording_id = right if right is not None else made_right
    if row.left_recording_id is not None and row.right_recording_id is not None:
        row.shown_at = now


def _replace(
    db: Session, trial: BoxTrial, query: OpenQuery, computed: Computed, now: datetime
) -> None:
    """Set the open query aside, and open the computed one at its index."""
    row = db.scalars(select(QueryRow).where(QueryRow.public_id == query.public_id)).one()
    lost = [status for _, status, _ in _sides(db, query.public_id) if status in states.LOST]
    row.set_aside_at = now
    row.fault = f"rollout {lost[0]}"
    candidates = candidate_rows.find_or_add(db, trial, computed.pair_points)
    box_queries.open_following(
        db, trial, query.trial_id, computed, candidates, now, attempt=query.attempt + 1
    )


_LEFT, _RIGHT = aliased(Rollout), aliased(Rollout)
_SIDES = (
    select(
        QueryRow.left_recording_id,
        _LEFT.status,
        _LEFT.recording_id,
        QueryRow.right_recording_id,
        _RIGHT.status,
        _RIGHT.recording_id,
    )
    .join(_LEFT, QueryRow.left_rollout_id == _LEFT.id)
    .join(_RIGHT, QueryRow.right_rollout_id == _RIGHT.id)
    .where(QueryRow.public_id == bindparam("public_id"))
)
