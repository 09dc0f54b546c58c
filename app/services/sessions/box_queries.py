"""The queries of a trial over a search space: its first, the next one, and replacements."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from datetime import datetime

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.proposals import box_steps
from app.services.proposals.box_steps import Point
from app.services.proposals.proposer import TrialSpec
from app.services.proposals.trial_schedule import (
    FILLER,
    REPLACEMENT_DRAW,
    AnsweredQueries,
    kind_at,
)
from app.services.rollouts import states
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Candidate, QueryRow, SessionRow
from app.study.attention_checks import Kind

from . import box_next, box_pairs, box_trials, candidate_rows, derived_rows, queries
from .box_next import Computed, Following
from .box_pairs import Pair
from .box_trials import BoxTrial


def read_following(
    db: Session, trial: BoxTrial, trial_id: int | None, record: AnsweredQueries
) -> Following:
    """What follows these answered queries, from what is learnt from and excluded now."""
    barred = box_trials.read_barred(db, trial, trial_id)
    points = box_trials.read_points(db, trial, box_trials.candidates_of(record, barred))
    return box_next.after(trial, record, barred, points)


def load_if_used(app: AppContext) -> None:
    """At the start of a process: load what proposals need, if a study over ranges is under way.

    In the background: the process serves meanwhile.
    """
    with app.database.read() as db:
        is_used = db.scalar(select(Candidate.id).where(Candidate.point_key.is_not(None)).limit(1))
    if is_used is not None:
        app.background.in_thread("load", box_steps.load)


def open_first(app: AppContext, db: Session, trial: BoxTrial, trial_id: int) -> QueryRow:
    """Store the first query of a trial. It depends on no response, so that no model is fitted."""
    computed = box_next.compute(app.proposer.boxes, read_following(db, trial, trial_id, ()))
    candidates = candidate_rows.find_or_add(db, trial, computed.points)
    return open_following(db, trial, trial_id, computed, candidates, app.now())


def ask_first_ahead(app: AppContext, db: Session, session: SessionRow, spec: TrialSpec) -> None:
    """Ask machines for the first pair of a trial that has not begun. spec: of that trial."""
    trial = box_trials.trial_of(session, spec)
    if trial is None or not trial.rollout.ahead:
        return
    computed = box_next.compute(app.proposer.boxes, read_following(db, trial, None, ()))
    candidates = candidate_rows.find_or_add(db, trial, computed.points)
    box_pairs.ask_ahead(db, trial, None, 0, candidates.values(), app.now())


def open_following(
    db: Session,
    trial: BoxTrial,
    trial_id: int,
    computed: Computed,
    candidates: Mapping[Point, Candidate],
    now: datetime,
    attempt: int = 0,
) -> QueryRow:
    """Store the query that was computed. candidates: the rows of `computed.points`."""
    following = computed.following
    if following.repeats is not None:
        return _open_repeat(db, trial, trial_id, following, now, attempt)
    assert computed.pair is not None
    pair = Pair(
        query_index=following.place,
        trial_type=computed.pair.trial_type,
        left=candidates[computed.pair.left],
        right=candidates[computed.pair.right],
        acquisition=computed.pair.acquisition,
        sources=following.sources[0],
    )
    return box_pairs.open_pair(db, trial, trial_id, pair, now, attempt=attempt)


def open_replacement(
    app: AppContext,
    db: Session,
    trial: BoxTrial,
    trial_id: int,
    tried: AnsweredQueries,
    now: datetime,
) -> QueryRow:
    """Store the query that replaces one whose video did not play in this browser.

    It shows a random pair of other candidates that are recorded. If there are fewer than two, the
    model proposes one without those tried. tried: all attempts at this index, oldest first.
    """
    last = tried[-1]
    spec, place, attempt = trial.spec, last.query_index, len(tried)
    barred = box_trials.read_barred(db, trial, trial_id)
    spent = {index for asked in tried for index in (asked.left, asked.right)}
    candidates = _recorded(db, trial, {*spent, *barred.excluded, *barred.failed})
    if len(candidates) >= 2:
        rng = np.random.default_rng([spec.seed, REPLACEMENT_DRAW, place, attempt])
        left, right = (candidates[int(one)] for one in rng.choice(len(candidates), 2, False))
        trial_type = "random" if kind_at(spec, place) is Kind.MODEL else FILLER
        pair = Pair(place, trial_type, left, right, "replacement", None)
        return box_pairs.open_pair(db, trial, trial_id, pair, now, attempt=attempt)
    record = queries.read_record(db, trial_id)
    without = replace(barred, failed=tuple(sorted({*barred.failed, *spent})))
    points = box_trials.read_points(db, trial, box_trials.candidates_of(record, without))
    computed = box_next.compute(app.proposer.boxes, box_next.after(trial, record, without, points))
    rows = candidate_rows.find_or_add(db, trial, computed.pair_points)
    return open_following(db, trial, trial_id, computed, rows, now, attempt)


def _recorded(db: Session, trial: BoxTrial, without: Collection[int]) -> list[Candidate]:
    """The candidates of the environment that are recorded, by index, without these indices."""
    rows = db.scalars(
        select(Candidate)
        .where(
            Candidate.study_id == trial.spec.study_id,
            Candidate.environment == trial.spec.environment,
            Candidate.candidate_index.not_in(sorted(without)),
            Candidate.id.in_(select(Rollout.candidate_id).where(Rollout.status == states.RECORDED)),
        )
        .order_by(Candidate.candidate_index)
    ).all()
    usable = box_pairs.usable_recordings(db, trial, [row.id for row in rows])
    return [row for row in rows if row.id in usable]


def store_derived(
    db: Session,
    query: QueryRow,
    computed: Computed,
    candidates: Mapping[Point, Candidate],
    record: AnsweredQueries,
) -> None:
    """Store the rows derived from the response to this query."""
    derived = box_next.derived(computed, candidates, record)
    if derived is None:
        return
    step, training = derived
    _, sources = computed.following.sources
    assert sources is not None
    if len(training) < len(record):
        # Earlier responses may have left the model, which numbers the others anew.
        derived_rows.replace_preferences(db, query.trial_id, step, training)
    else:
        derived_rows.store_new_preferences(db, query, step, training)
    derived_rows.store_acquired(db, query, step, computed_from=sources.as_json())


def _open_repeat(
    db: Session,
    trial: BoxTrial,
    trial_id: int,
    following: Following,
    now: datetime,
    attempt: int,
) -> QueryRow:
    repeats = following.repeats
    assert repeats is not None
    earlier = db.scalars(
        select(QueryRow).where(
            QueryRow.trial_id == trial_id,
            QueryRow.query_index == repeats.query_index,
            QueryRow.set_aside_at.is_(None),
        )
    ).one()
    rows = db.scalars(
        select(Candidate).where(
            Candidate.study_id == trial.spec.study_id,
            Candidate.environment == trial.spec.environment,
            Candidate.candidate_index.in_((repeats.left, repeats.right)),
        )
    )
    by_index = {row.candidate_index: row for row in rows}
    pair = Pair(
        query_index=following.place,
        trial_type=Kind.REPEAT.value,
        left=by_index[repeats.right],
        right=by_index[repeats.left],
        acquisition="repeat",
        sources=None,
        repeats=repeats.query_index,
    )
    return box_pairs.open_pair(db, trial, trial_id, pair, now, attempt=attempt, earlier=earlier)
