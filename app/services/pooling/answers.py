"""Reads all answers under a condition, as those of several people about the same candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy import ColumnElement, select
from sqlalchemy.orm import Session

from app.pbbo import SKIP_REASONS, Settings
from app.pbbo.people_answers import PersonAnswer
from app.services.proposals.people_summaries import PeopleRequest
from app.services.proposals.trial_schedule import is_training
from app.services.rollouts import lookup as rollouts
from app.services.sessions import queries
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import Candidate, Participant, QueryRow, SessionRow, Trial


@dataclass(frozen=True)
class PooledAnswers:
    """The answers under one condition.

    request: for the summary.  candidates: the candidate index of each of its points.
    sessions: primary keys of the sessions, by participant.  shown: how often each candidate was
    shown in an answered pair, by row.
    """

    condition: str
    environment: str
    request: PeopleRequest
    candidates: tuple[int, ...]
    sessions: dict[str, tuple[int, ...]]
    shown: tuple[int, ...]

    @property
    def people(self) -> int:
        """How many people have answered."""
        return len({answer.person for answer in self.request.history})


def read(db: Session, study: StudyInfo, condition: str, *of: ColumnElement[bool]) -> PooledAnswers:
    """The answers that the models learnt from, under a condition of the plan.

    of: conditions on sessions and trials.  A participant is one person, in however many sessions.
    A skip without a reason means what the condition says it means.
    """
    plan = study.plan
    named = next(one for one in plan.conditions if one.name == condition)
    rows = db.execute(
        select(Trial, Participant.pseudonym)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .where(
            Trial.trial_index >= 0,
            Trial.condition == condition,
            Trial.environment == named.environment,
            *of,
        )
        .order_by(SessionRow.id, Trial.trial_index)
    ).all()
    settings = dict(named.optimizer_settings)
    means = Settings.from_mapping(settings).threshold_skip_means
    given: list[tuple[str, int, int, str, str | None]] = []
    sessions: dict[str, dict[int, None]] = {}
    for trial, person in rows:
        spec = queries.trial_spec(trial.session, trial.trial_index, trial.seed)
        gone = _withdrawn(db, trial.id) if plan.has_ranges else frozenset()
        for shown in queries.read_record(db, trial.id):
            if not is_training(spec, shown.trial_type) or shown.query_index in gone:
                continue
            reason = None
            if shown.response == "skip":
                reason = shown.skip_reason if shown.skip_reason in SKIP_REASONS else means
            given.append((person, shown.left, shown.right, shown.response or "", reason))
            sessions.setdefault(person, {})[trial.session_id] = None
    points, candidates, excluded = _points(db, study, named.environment, given)
    row_of = {index: row for row, index in enumerate(candidates)}
    history = tuple(
        PersonAnswer(person, row_of[left], row_of[right], response, reason)  # type: ignore[arg-type]
        for person, left, right, response, reason in given
    )
    shown_rows = np.array([(one.left, one.right) for one in history], dtype=np.intp).ravel()
    return PooledAnswers(
        condition,
        named.environment,
        PeopleRequest(
            points,
            plan.space if plan.has_ranges else None,
            settings,
            history,
            tuple(row_of[index] for index in excluded if index in row_of),
            frozenset(trial.seed for trial, _ in rows),
        ),
        candidates,
        {person: tuple(keys) for person, keys in sessions.items()},
        tuple(np.bincount(shown_rows, minlength=len(candidates)).tolist()),
    )


def _withdrawn(db: Session, trial_id: int) -> frozenset[int]:
    """Indices of the trial's queries whose recordings were withdrawn."""
    return frozenset(
        db.scalars(
            select(QueryRow.query_index).where(
                QueryRow.trial_id == trial_id,
                QueryRow.withdrawn_at.is_not(None),
                QueryRow.set_aside_at.is_(None),
            )
        )
    )


def _points(
    db: Session,
    study: StudyInfo,
    environment: str,
    given: Sequence[tuple[str, int, int, str, str | None]],
) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float64]], tuple[int, ...], tuple[int, ...]]:
    """The candidates' points (n, d), their indices, and the indices of unsafe ones.

    All of a list; in a space given by ranges those that were shown or are unsafe.
    """
    names = [parameter.name for parameter in study.plan.parameters]
    at = {
        index: [float(parameters[name]) for name in names]
        for index, parameters in db.execute(
            select(Candidate.candidate_index, Candidate.parameters)
            .where(Candidate.study_id == study.id, Candidate.environment == environment)
            .order_by(Candidate.candidate_index)
        )
    }
    unsafe: tuple[int, ...] = ()
    if study.plan.has_ranges:
        unsafe = tuple(sorted(rollouts.unsafe_candidates(db, study.id, environment)))
        wanted = {index for _, left, right, _, _ in given for index in (left, right)} | set(unsafe)
        at = {index: point for index, point in at.items() if index in wanted}
    points = np.array(list(at.values()), dtype=np.float64).reshape(len(at), len(names))
    return points, tuple(at), unsafe
