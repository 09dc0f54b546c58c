"""The open query of a trial over a search space in STATE: its videos, or what is waited for."""

from __future__ import annotations

from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.proposals.proposer import RecordingRef
from app.services.recordings.addresses import Place
from app.services.rollouts import durations
from app.services.studies.repository import stored_plan
from app.storage.models.studies import QueryRow, SessionRow

from . import box_ahead, box_trials, queries, query_view
from .queries import OpenQuery


def describe(
    app: AppContext, db: Session, session: SessionRow, known: OpenQuery | None = None
) -> dict[str, Any]:
    """`query` of STATE, and `waiting` while a video of the open query is not recorded yet."""
    query = known or queries.load_open_query(db, session, session.trial_index)
    asked = query.asked
    spec = queries.trial_spec(session, query.trial_index, query.seed, asked.engine_version)
    trial = box_trials.trial_of(session, spec)
    assert trial is not None
    coming = box_ahead.prepare(app, db, trial, query)
    place = (query.trial_index, asked.query_index)
    shown = [one for one in (asked.left_recording, asked.right_recording) if one is not None]
    clips = {clip.id: clip for clip in box_ahead.read_clips(db, shown)}
    left, right = (
        None if one is None else query_view.video(app, session, clips[one], place)
        for one in (asked.left_recording, asked.right_recording)
    )
    if left is None or right is None:
        return {"query": None, "waiting": _waiting(app, db, session, query, left, right)}
    plan = stored_plan(session.plan)
    condition = plan.conditions[session.trial_conditions[session.trial_index]]
    then = (query.trial_index, asked.query_index + 1)
    state: dict[str, Any] = {
        "id": query.public_id,
        "left": left,
        "right": right,
        "skip": query_view.skip_of(plan, condition, session.language, session.skip_reason_order),
        "prefetch": _prefetch(app, db, session, then, box_ahead.recorded_clips(db, trial, coming)),
    }
    return {"query": state | query_view.options(app, db, session, query)}


def _prefetch(
    app: AppContext, db: Session, session: SessionRow, then: Place, clips: list[RecordingRef]
) -> list[str]:
    return list(dict.fromkeys(query_view.address(app, session, clip, then) for clip in clips))


def _waiting(
    app: AppContext,
    db: Session,
    session: SessionRow,
    query: OpenQuery,
    left: dict[str, Any] | None,
    right: dict[str, Any] | None,
) -> dict[str, Any]:
    """What is waited for, since when, and how long it usually takes."""
    since = db.scalar(select(QueryRow.created_at).where(QueryRow.public_id == query.public_id))
    expected = durations.expectation(db, session.study_id, query.environment, app.now())
    waiting: dict[str, Any] = {
        "since": None if since is None else since.isoformat().replace("+00:00", "Z"),
        "usually_s": expected.usually_s,
        "machines": expected.machines,
        "left": left,
        "right": right,
    }
    if undo := query_view.undo_offer(app, db, session, query):
        waiting["undo"] = undo
    return waiting
