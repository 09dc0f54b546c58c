"""Computes a trial under a shared model again, from what its rows say they were computed from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.pbbo import EARLIER_PEOPLE_ENGINES
from app.services.context import AppContext
from app.services.proposals.computation import AcquiredCandidate
from app.services.proposals.trial_schedule import AnsweredQueries, check_at, training_records
from app.storage.models.studies import Acquired, PreferenceRow, QueryRow, Trial

from . import early_end, queries, shared_next, shared_trials
from .shared_queries import preferences
from .shared_trials import SharedAnswer, SharedTrial, Sources


@dataclass
class SharedReplay:
    """The result for one trial.

    differences: what, stored, computed; see `replay.Difference`. gone: queries and acquired
    candidates that cannot be computed again, because answers that they were computed from were
    deleted or taken back since. earlier: those that are not computed again, because their trial
    began under a version of the engine whose steps differ.
    """

    differences: list[tuple[str, tuple[Any, ...], tuple[Any, ...]]] = field(default_factory=list)
    gone: int = 0
    earlier: int = 0


def trial_of(trial: Trial) -> SharedTrial | None:
    """The stored trial under a shared model; None if its model is its person's own."""
    spec = queries.trial_spec(
        trial.session, trial.trial_index, trial.seed, trial.queries[0].engine_version
    )
    return shared_trials.trial_of(trial.session, trial.trial_index, spec)


def replay(app: AppContext, db: Session, trial: Trial, shared: SharedTrial) -> SharedReplay:
    """Compute each query and each acquired candidate again, as far as its answers are there."""
    found = SharedReplay()
    record = queries.read_record(db, trial.id)
    acquired = db.scalars(
        select(Acquired).where(Acquired.trial_id == trial.id).order_by(Acquired.query_index)
    ).all()
    if shared.spec.engine_version in EARLIER_PEOPLE_ENGINES:
        found.earlier = len(trial.queries) + len(acquired)
    else:
        _replay_steps(app, db, trial, shared, record, acquired, found)
    kept, computed = _preferences(db, shared, trial, record)
    if kept != computed:
        found.differences.append(
            ("preferences", tuple(sorted(kept - computed)), tuple(sorted(computed - kept)))
        )
    return found


def _replay_steps(
    app: AppContext,
    db: Session,
    trial: Trial,
    shared: SharedTrial,
    record: AnsweredQueries,
    acquired: Sequence[Acquired],
    found: SharedReplay,
) -> None:
    """Compare queries, acquired candidates and the end of the trial, and add to what was found."""
    if shared.spec.sure is None:
        # Not compared, and costs time.
        shared = replace(shared, spec=replace(shared.spec, within=None))
    answers = shared_trials.read_answers(db, shared)
    for row in trial.queries:
        # A replacement for a video that did not play depends on which recordings were available.
        if row.attempt > 0:
            continue
        was = (
            row.left_candidate,
            row.right_candidate,
            row.left_recording_id,
            row.right_recording_id,
        )
        would_be = _query(app, shared, row, record, answers)
        if would_be is None:
            found.gone += 1
        elif was != would_be:
            found.differences.append((f"query {row.query_index}", was, would_be))
    sure = []
    for stored in acquired:
        was_at = AcquiredCandidate(stored.candidate, None, None, stored.sureness)
        computed = _acquired(app, shared, stored, answers)
        if computed is None:
            found.gone += 1
        elif computed.candidate != stored.candidate:
            what = f"acquired after query {stored.query_index}"
            found.differences.append((what, (stored.candidate,), (computed.candidate,)))
        # Where answers are gone, what the model said then is all that is known.
        sure += [stored.query_index] if shared.spec.is_sure(computed or was_at) else []
    ended = early_end.difference(trial, shared.spec, len(record), sure)
    if ended is not None:
        found.differences.append((early_end.WHAT, ended[:1], ended[1:]))


def _query(
    app: AppContext,
    shared: SharedTrial,
    row: QueryRow,
    record: AnsweredQueries,
    answers: tuple[SharedAnswer, ...],
) -> tuple[int, ...] | None:
    """Candidates and recordings of a query, left and right; None if they cannot be computed."""
    if row.proposed_from is None:
        space = app.proposer.candidate_set(shared.study_id, shared.spec.environment)
        query = check_at(space, shared.spec, record[: row.query_index], row.query_index)
    else:
        sources = Sources.from_json(row.proposed_from)
        used = _used(shared, sources, answers)
        if used is None:
            return None
        request = shared_next.request_from(
            app, shared, used, sources.avoided, choices=1, acquires=False
        )
        [choice] = app.proposer.shared.step(request).choices
        query = shared_next.proposed(app, shared, choice, row.query_index)
    return query.left_candidate, query.right_candidate, query.left.id, query.right.id


def _acquired(
    app: AppContext, shared: SharedTrial, stored: Acquired, answers: tuple[SharedAnswer, ...]
) -> AcquiredCandidate | None:
    """What was acquired; None if it cannot be computed."""
    sources = Sources.from_json(stored.computed_from or {})
    used = _used(shared, sources, answers)
    if used is None:
        return None
    request = shared_next.request_from(app, shared, used, (), choices=0)
    return app.proposer.shared.step(request).acquired


def _used(
    shared: SharedTrial, sources: Sources, answers: tuple[SharedAnswer, ...]
) -> list[SharedAnswer] | None:
    """The answers of these sources; None if one of them is gone."""
    used = shared_trials.within(answers, sources.answers)
    return used if shared_trials.digest(shared, used) == sources.digest else None


def _preferences(
    db: Session, shared: SharedTrial, trial: Trial, record: AnsweredQueries
) -> tuple[set[tuple[int, ...]], set[tuple[int, ...]]]:
    """The trial's preferences as stored, and as its own choices are: query, winner, loser."""
    columns = (PreferenceRow.query_index, PreferenceRow.winner, PreferenceRow.loser)
    rows = db.execute(select(*columns).where(PreferenceRow.trial_id == trial.id))
    training = training_records(shared.spec, record)
    return {tuple(row) for row in rows}, {
        (training[one.query_index].query_index, one.winner, one.loser)
        for one in preferences(training)
    }
