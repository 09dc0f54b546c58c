"""Computes what may follow the open query of a trial over a search space, and records it ahead.

While a pair plays, the step after each possible response is computed in the background, and
machines are asked for the recordings that the next pair may need, the likeliest first. What a
response has made pointless is taken back. Nothing is lost with the process: the next look at the
session starts the work again.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Final

from sqlalchemy import event, select, update
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.proposals.proposer import RecordingRef
from app.services.rollouts import requests, states
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import QueryRow, Recording, Response, SessionRow, Trial

from . import box_next, box_pairs, box_trials, candidate_rows
from .box_next import Computed, Following
from .box_trials import Barred, BoxTrial
from .queries import OpenQuery

#: How often the work is begun anew because recordings were withdrawn or unsafe meanwhile.
MOST_ROUNDS: Final = 8


def prepare(app: AppContext, db: Session, trial: BoxTrial, query: OpenQuery) -> Sequence[Computed]:
    """Start to compute and to record what may follow the open query.

    Returns what may follow it, the likeliest first; empty until all of it is computed. Within a
    writing transaction, the work starts after its commit.
    """
    _, possible = _possible(app, db, trial, query)
    computed = [box_next.cached(app.proposer.boxes, following) for following in possible]
    complete = [one for one in computed if one is not None]
    is_prepared = app.proposer.boxes.is_prepared(query.public_id, possible)
    if len(complete) < len(possible) or not is_prepared:
        key = ("ahead", trial.spec.seed, query.public_id)

        def start(_db: Session | None = None) -> None:
            app.background.in_thread(key, _work, app, trial, query)

        if app.database.is_writing(db):
            event.listen(db, "after_commit", start, once=True)
        else:
            start()
    return complete if len(complete) == len(possible) else ()


def recorded_clips(db: Session, trial: BoxTrial, coming: Sequence[Computed]) -> list[RecordingRef]:
    """The recordings that exist of the pairs that may come next, the likeliest first."""
    points = [point for computed in coming for point in computed.pair_points]
    if not points:
        return []
    candidates = candidate_rows.find(db, trial, points)
    usable = box_pairs.usable_recordings(db, trial, [row.id for row in candidates.values()])
    ids = [rollout.recording_id for rollout in usable.values()]
    clips = {clip.id: clip for clip in read_clips(db, [one for one in ids if one is not None])}
    found = []
    for point in points:
        rollout = usable.get(candidates[point].id) if point in candidates else None
        if rollout is not None and rollout.recording_id is not None:
            found.append(clips[rollout.recording_id])
    return list(dict.fromkeys(found))


def read_clips(db: Session, recording_ids: Sequence[int]) -> list[RecordingRef]:
    """These recordings (primary keys)."""
    rows = db.execute(
        select(
            Recording.id,
            Recording.public_id,
            Recording.duration_s,
            Recording.source,
            Recording.locator,
            Recording.score,
        ).where(Recording.id.in_(recording_ids))
    )
    return [RecordingRef(*row) for row in rows]


def leave(db: Session, session_id: int, now: datetime) -> None:
    """Take back what machines were asked for by a session that ends, and have not begun.

    A query that waits for its recording is set aside: nobody will see it. Does nothing in a study
    with a list of candidates.
    """
    trials = db.scalars(
        select(Rollout.trial_id)
        .join(Trial, Rollout.trial_id == Trial.id)
        .where(Trial.session_id == session_id, Rollout.status == states.ASKED)
        .distinct()
    ).all()
    for trial_id in trials:
        if trial_id is not None:
            db.execute(
                update(QueryRow)
                .where(
                    QueryRow.trial_id == trial_id,
                    QueryRow.shown_at.is_(None),
                    QueryRow.set_aside_at.is_(None),
                )
                .values(set_aside_at=now, fault="the session ended before it was recorded")
            )
            requests.take_back(db, trial_id, (), now)


def _possible(
    app: AppContext, db: Session, trial: BoxTrial, query: OpenQuery
) -> tuple[Barred, tuple[Following, ...]]:
    """What is barred now, and what follows each possible response, the likeliest first."""
    barred = box_trials.read_barred(db, trial, query.trial_id)
    needed = box_trials.candidates_of((*query.record, query.asked), barred)
    points = box_trials.read_points(db, trial, needed)
    # The model expects a side to win, if its step is cached.
    before = box_next.after(trial, query.record, barred, points)
    step = None if before.query is None else app.proposer.boxes.cached(before.query[1])
    likelier = "left" if step is None or step.pair is None else step.pair.likelier
    futures = box_next.futures(trial, query.record, query.asked, barred, points, likelier)
    return barred, tuple(futures)


def _work(app: AppContext, trial: BoxTrial, query: OpenQuery) -> None:
    """Compute what may follow, ask for its recordings, and take back what is pointless."""
    for _ in range(MOST_ROUNDS):
        with app.database.read() as db:
            if not is_open(db, query.public_id):
                return
            barred, possible = _possible(app, db, trial, query)
        app.proposer.boxes.steps(
            list(dict.fromkeys(request for following in possible for request in following.requests))
        )
        coming = [box_next.compute(app.proposer.boxes, following) for following in possible]
        with app.database.write() as db:
            _lock_session(db, query.public_id)
            if not is_open(db, query.public_id):
                return
            if box_trials.read_barred(db, trial, query.trial_id) != barred:
                continue
            _ask(app, db, trial, query, coming)
        app.proposer.boxes.mark_prepared(query.public_id, possible)
        return


def _lock_session(db: Session, public_id: str) -> None:
    """Lock the session of this query, as responses and withdrawals do.

    A statement of its own: PostgreSQL lets one that waited for a lock see only the locked row anew.
    """
    db.execute(
        select(SessionRow.id)
        .join(Trial, Trial.session_id == SessionRow.id)
        .join(QueryRow, QueryRow.trial_id == Trial.id)
        .where(QueryRow.public_id == public_id)
        .with_for_update(of=SessionRow)
    )


def _ask(
    app: AppContext, db: Session, trial: BoxTrial, query: OpenQuery, coming: Sequence[Computed]
) -> None:
    now = app.now()
    points = [point for computed in coming for point in computed.pair_points]
    kept: list[int] = []
    if points and trial.rollout.ahead:
        candidates = candidate_rows.find_or_add(db, trial, points)
        in_order = [candidates[point] for point in dict.fromkeys(points)]
        place = query.asked.query_index + 1
        kept = box_pairs.ask_ahead(db, trial, query.trial_id, place, in_order, now)
    requests.take_back(db, query.trial_id, kept, now)


def is_open(db: Session, public_id: str) -> bool:
    """Whether a session that goes on has this query, neither set aside nor responded to."""
    found = db.scalar(
        select(QueryRow.id)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .outerjoin(Response, Response.query_id == QueryRow.id)
        .where(
            QueryRow.public_id == public_id,
            QueryRow.set_aside_at.is_(None),
            SessionRow.ended_at.is_(None),
            Response.id.is_(None),
        )
    )
    return found is not None
