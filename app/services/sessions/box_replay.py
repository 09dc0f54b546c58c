"""Computes a trial over a search space again from what its rows say they were computed from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.proposals.box_steps import Point, compute_box_step, point_key
from app.services.proposals.trial_schedule import AnsweredQueries, is_training
from app.storage.models.studies import Acquired, PreferenceRow, Trial

from . import box_trials, early_end, queries
from .box_trials import BoxTrial, Sources


@dataclass(frozen=True)
class Mismatch:
    """A stored value that the computation does not reproduce; see `replay.Difference`."""

    what: str
    stored: tuple[Any, ...]
    computed: tuple[Any, ...]


def differences(db: Session, trial: Trial) -> Iterator[Mismatch]:
    """What the computation does not reproduce, query by query.

    Points are compared, not recordings: which of them existed depended on machines.
    """
    spec = queries.trial_spec(
        trial.session, trial.trial_index, trial.seed, trial.queries[0].engine_version
    )
    if spec.sure is None:
        # Not compared, and half of the work.
        spec = replace(spec, within=None)
    box = box_trials.trial_of(trial.session, spec)
    assert box is not None
    record = queries.read_record(db, trial.id)
    acquired = db.scalars(
        select(Acquired).where(Acquired.trial_id == trial.id).order_by(Acquired.query_index)
    ).all()
    proposed = [row for row in trial.queries if row.proposed_from is not None]
    sources = [Sources.from_json(row.proposed_from or {}) for row in proposed]
    sources_acquired = [Sources.from_json(row.computed_from or {}) for row in acquired]
    needed = box_trials.candidates_of(record, box_trials.Barred(), *sources, *sources_acquired)
    needed.update(one for row in proposed for one in (row.left_candidate, row.right_candidate))
    needed.update(row.candidate for row in acquired)
    points = box_trials.read_points(db, box, needed)
    for row, source in zip(proposed, sources, strict=True):
        request = box_trials.request(box, record, source, points, proposes=True, acquires=False)
        pair = compute_box_step(request).pair
        assert pair is not None
        was = (_key(box, points[row.left_candidate]), _key(box, points[row.right_candidate]))
        would_be = (_key(box, pair.left), _key(box, pair.right))
        if was != would_be:
            attempt = f", attempt {row.attempt}" if row.attempt else ""
            yield Mismatch(f"query {row.query_index}{attempt}", was, would_be)
    sure = []
    for row_acquired, source in zip(acquired, sources_acquired, strict=True):
        request = box_trials.request(box, record, source, points, proposes=False, acquires=True)
        found = compute_box_step(request).acquired
        if spec.is_sure(found):
            sure.append(row_acquired.query_index)
        stored = _key(box, points[row_acquired.candidate])
        computed = None if found is None else _key(box, found.point)
        if stored != computed:
            what = f"acquired after query {row_acquired.query_index}"
            yield Mismatch(what, (stored,), (computed,))
    gone = {row.query_index for row in trial.queries if row.withdrawn_at is not None}
    # A trial that ended stays ended, however sure it is without what was withdrawn.
    ended = None if gone else early_end.difference(trial, spec, len(record), sure)
    if ended is not None:
        yield Mismatch(early_end.WHAT, ended[:1], ended[1:])
    if sources_acquired and (stale := gone & {*sources_acquired[-1].answered}):
        what = f"what was learnt of the candidate acquired after query {acquired[-1].query_index}"
        yield Mismatch(what, tuple(sorted(stale)), ())
    yield from _preferences(db, box, trial, record)


def withdrawn(trial: Trial) -> int:
    """The number of the trial's responses that are not learnt from any more."""
    return sum(row.withdrawn_at is not None for row in trial.queries)


def _preferences(
    db: Session, box: BoxTrial, trial: Trial, record: AnsweredQueries
) -> Iterator[Mismatch]:
    """The preferences that are stored and should not be, and those that are missing."""
    gone = {row.query_index for row in trial.queries if row.withdrawn_at is not None}
    kept = db.execute(
        select(PreferenceRow.query_index, PreferenceRow.winner, PreferenceRow.loser).where(
            PreferenceRow.trial_id == trial.id
        )
    )
    stored = {tuple(row) for row in kept}
    computed = set()
    for one in record:
        if is_training(box.spec, one.trial_type) and one.query_index not in gone:
            pair = (one.left, one.right)
            if one.response != "skip":
                computed.add((one.query_index, *(pair if one.response == "left" else pair[::-1])))
    if stored != computed:
        yield Mismatch(
            "preferences", tuple(sorted(stored - computed)), tuple(sorted(computed - stored))
        )


def _key(box: BoxTrial, point: Point) -> str:
    return point_key(box.space, point)
