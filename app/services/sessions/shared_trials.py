"""Trials under a model that all people of a condition share: what their steps are computed from.

A step depends on the answers of all sessions of the condition and on the pairs that others are
looking at. Which these were is stored with every query and every acquired candidate, so that each
can be computed again from its row.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache
from hashlib import sha256
from typing import Any, Final, Literal, NamedTuple, Self

from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session

from app.pbbo import SKIP_REASONS, learns_reasons
from app.services.proposals.proposer import TrialSpec
from app.services.proposals.shared_steps import Pair, PersonsAnswer
from app.services.proposals.trial_schedule import AskedQuery, is_training
from app.services.studies.repository import stored_plan
from app.storage.advisory_lock import advisory_xact_lock
from app.storage.json_rows import AsOneRow
from app.storage.models.studies import QueryRow, Response, SessionRow, Trial
from app.study.stage_settings import PRACTICE_INDEX
from app.study.stages import Stage

#: Hexadecimal digits of the digest of a history.
_DIGEST: Final = 16


@dataclass(frozen=True)
class SharedTrial:
    """The constants of one person's trial under a shared model.

    spec: of the trial, with its own seed. person: the participant's primary key. lease: how long
    the pair of a session that is not heard of counts as looked at.
    """

    spec: TrialSpec
    study_id: int
    condition: str
    mode: str
    session_id: int
    person: int
    target: Literal["population", "person"]
    lease: timedelta

    @property
    def seed(self) -> int:
        """The seed of the shared model: 48 bits, the same in all sessions of the condition."""
        return _shared_seed(self.study_id, self.condition, self.mode)


class SharedAnswer(NamedTuple):
    """One person's answer. id: its response's primary key. seed: its trial's."""

    id: int
    person: int
    seed: int
    left: int
    right: int
    response: str
    reason: str | None


@dataclass(frozen=True)
class Moment:
    """All answers under the condition at one moment, and the pairs that others are looking at.

    answers: those that are learnt from, in order. gone: ids of those of people who have withdrawn.
    """

    answers: tuple[SharedAnswer, ...]
    gone: frozenset[int]
    open: tuple[Pair, ...]


@dataclass(frozen=True)
class Sources:
    """What a step is computed from, besides the candidates, the settings and the seed.

    answers: runs of responses, each from one primary key to another, both included, of all
    responses under the condition. number: how many these were. digest: of what they were, by which
    a run that lacks some or has others is recognised. avoided: pairs that others were looking at.
    """

    answers: tuple[tuple[int, int], ...]
    number: int
    digest: str
    avoided: tuple[Pair, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """As it is stored."""
        return {
            "shared": [list(run) for run in self.answers],
            "number": self.number,
            "digest": self.digest,
            "avoided": [list(pair) for pair in self.avoided],
        }

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Self:
        """As it was stored."""
        return cls(
            tuple((first, last) for first, last in stored["shared"]),
            stored["number"],
            stored["digest"],
            tuple((left, right) for left, right in stored["avoided"]),
        )


def trial_of(session: SessionRow, trial_index: int, spec: TrialSpec) -> SharedTrial | None:
    """The session's trial of this specification; None if its model is its person's own."""
    if trial_index == PRACTICE_INDEX:
        return None
    plan = stored_plan(session.plan)
    condition = plan.conditions[session.trial_conditions[trial_index]]
    if not condition.is_shared:
        return None
    return SharedTrial(
        spec=spec,
        study_id=session.study_id,
        condition=condition.name,
        mode=session.mode,
        session_id=session.id,
        person=session.participant_id,
        target=condition.finds,
        lease=timedelta(minutes=plan.lease_minutes),
    )


def answer_to(trial: SharedTrial, asked: AskedQuery) -> SharedAnswer:
    """An answer of the trial's person that is not stored yet."""
    return SharedAnswer(
        id=0,
        person=trial.person,
        seed=trial.spec.seed,
        left=asked.left,
        right=asked.right,
        response=asked.response or "",
        reason=asked.skip_reason,
    )


def lock(db: Session, trial: SharedTrial) -> None:
    """Exclude other transactions that store answers or queries under shared models of the study.

    Held until the transaction ends, within which nothing is computed. Primary keys of responses are
    thereby in the order in which they became known, and no pair is opened twice at one moment.
    """
    advisory_xact_lock(db, f"shared model of study {trial.study_id}")


def read_moment(db: Session, trial: SharedTrial, now: datetime) -> Moment:
    """What is known now."""
    answers, gone = [], set()
    for *row, stage in _rows(db, trial):
        answer = SharedAnswer(*row)
        if stage == Stage.WITHDRAWN:
            gone.add(answer.id)
        else:
            answers.append(answer)
    open_pairs = db.execute(
        _OPEN, {**_of(trial), "session_id": trial.session_id, "since": now - trial.lease}
    )
    return Moment(
        tuple(answers),
        frozenset(gone),
        tuple(sorted({(min(pair), max(pair)) for pair in map(tuple, open_pairs)})),
    )


def read_answers(db: Session, trial: SharedTrial) -> tuple[SharedAnswer, ...]:
    """All answers under the condition in order, also of people who have withdrawn."""
    return tuple(SharedAnswer(*row) for *row, _ in _rows(db, trial))


def history(
    trial: SharedTrial, answers: Iterable[SharedAnswer]
) -> tuple[tuple[PersonsAnswer, ...], Mapping[int, str]]:
    """The answers as the optimiser reads them, and what it calls each person.

    People are numbered by their first answer.
    """
    with_reasons = learns_reasons(trial.spec.method, trial.spec.engine_version)
    names: dict[int, str] = {}
    found = []
    for answer in answers:
        name = names.setdefault(answer.person, str(len(names)))
        reason = answer.reason if with_reasons and answer.reason in SKIP_REASONS else None
        found.append((answer.left, answer.right, answer.response, reason, name))
    return tuple(found), names


def sources(
    trial: SharedTrial,
    used: Sequence[SharedAnswer],
    known: Iterable[int],
    avoided: Sequence[Pair] = (),
) -> Sources:
    """The sources of a step. used: the answers learnt from, in order. known: ids of all there are,
    these among them."""
    ids = {answer.id for answer in used}
    runs: list[tuple[int, int]] = []
    goes_on = False
    for one in sorted({*known, *ids}):
        if one in ids:
            runs = [*runs[:-1], (runs[-1][0], one)] if goes_on else [*runs, (one, one)]
        goes_on = one in ids
    return Sources(tuple(runs), len(used), digest(trial, used), tuple(avoided))


def within(answers: Iterable[SharedAnswer], runs: Sequence[tuple[int, int]]) -> list[SharedAnswer]:
    """The answers within these runs, in order."""
    return [one for one in answers if any(first <= one.id <= last for first, last in runs)]


def digest(trial: SharedTrial, answers: Iterable[SharedAnswer]) -> str:
    """A digest of what the optimiser learns from these answers."""
    learnt, _ = history(trial, answers)
    return sha256(repr(learnt).encode()).hexdigest()[:_DIGEST]


@lru_cache(maxsize=256)
def _shared_seed(study_id: int, condition: str, mode: str) -> int:
    key = f"shared model {study_id} {mode} {condition}"
    return int.from_bytes(sha256(key.encode()).digest()[:6])


def _of(trial: SharedTrial) -> dict[str, Any]:
    return {"study_id": trial.study_id, "mode": trial.mode, "condition": trial.condition}


def _rows(db: Session, trial: SharedTrial) -> Iterable[Sequence[Any]]:
    """The columns of `SharedAnswer` and the session's stage, of all answers that are learnt from,
    by id."""
    found = [
        row
        for trial_type, *row in _ANSWERS.read(db, _of(trial))
        if is_training(trial.spec, trial_type)
    ]
    return sorted(found, key=lambda row: int(row[0]))


_UNDER = (
    SessionRow.study_id == bindparam("study_id"),
    SessionRow.mode == bindparam("mode"),
    Trial.condition == bindparam("condition"),
)
#: Columns of `_ANSWERS`: the query's type, those of `SharedAnswer`, and the session's stage.
_COLUMNS: tuple[Any, ...] = (
    QueryRow.trial_type,
    Response.id,
    SessionRow.participant_id,
    Trial.seed,
    QueryRow.left_candidate,
    QueryRow.right_candidate,
    Response.response,
    Response.skip_reason,
    SessionRow.stage,
)
_ANSWERS = AsOneRow(
    select(*_COLUMNS)
    .join(QueryRow, Response.query_id == QueryRow.id)
    .join(Trial, QueryRow.trial_id == Trial.id)
    .join(SessionRow, Trial.session_id == SessionRow.id)
    .where(*_UNDER, QueryRow.withdrawn_at.is_(None))
)
_OPEN = (
    select(QueryRow.left_candidate, QueryRow.right_candidate)
    .join(Trial, QueryRow.trial_id == Trial.id)
    .join(SessionRow, Trial.session_id == SessionRow.id)
    .outerjoin(Response, Response.query_id == QueryRow.id)
    .where(
        *_UNDER,
        SessionRow.id != bindparam("session_id"),
        SessionRow.stage == Stage.QUERY.value,
        SessionRow.last_seen_at > bindparam("since"),
        SessionRow.trial_index == Trial.trial_index,
        QueryRow.set_aside_at.is_(None),
        Response.id.is_(None),
    )
)
