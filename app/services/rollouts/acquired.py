"""Recordings of what trials acquired: asked for by an experimenter when trials have ended.

A pair shows candidates that are worth comparing; the candidate of the largest posterior mean need
not be among them, so that a finished trial may have no video of its result.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.session_modes import OF_PEOPLE
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Acquired, Candidate, SessionRow, Trial

from . import claims, requests, states

#: After what a query waits for, before what may come next.
PRIORITY: Final = 5
#: Separates the seeds of these runs from the other uses of a trial's seed.
_DRAW: Final = 113
#: A candidate with a rollout in one of these states is not asked for.
_SETTLED: Final = (states.RECORDED, states.UNSAFE, states.ASKED, states.CLAIMED)


def unrecorded(db: Session, study_id: int) -> list[tuple[Trial, Candidate]]:
    """The acquired candidates without a recording, each with the first trial that acquired it.

    Of trials that have ended, of sessions in which a person responded, in environments of machines.
    Candidates that are unsafe or have been asked for are left out.
    """
    plan = claims.plan_of(db, study_id)
    environments = [name for name, one in plan.environments.items() if one.is_machine]
    last = (
        select(Acquired.trial_id, func.max(Acquired.query_index).label("query_index"))
        .group_by(Acquired.trial_id)
        .subquery()
    )
    settled = select(Rollout.candidate_id).where(
        Rollout.study_id == study_id, Rollout.status.in_(_SETTLED)
    )
    rows = db.execute(
        select(Trial, Candidate)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .join(last, last.c.trial_id == Trial.id)
        .join(
            Acquired,
            (Acquired.trial_id == Trial.id) & (Acquired.query_index == last.c.query_index),
        )
        .join(
            Candidate,
            (Candidate.study_id == SessionRow.study_id)
            & (Candidate.environment == Trial.environment)
            & (Candidate.candidate_index == Acquired.candidate),
        )
        .where(
            SessionRow.study_id == study_id,
            SessionRow.mode.in_(OF_PEOPLE),
            Trial.ended_at.is_not(None),
            Trial.trial_index >= 0,
            Trial.environment.in_(environments),
            Candidate.id.not_in(settled),
        )
        .order_by(Trial.id)
    )
    first: dict[int, tuple[Trial, Candidate]] = {}
    for trial, candidate in rows:
        first.setdefault(candidate.id, (trial, candidate))
    return list(first.values())


def ask(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> int:
    """Ask machines for the recordings that `unrecorded` names; return their number.

    Raises NotFoundError if there is no such study.
    """
    with app.database.write() as db:
        study_id = repository.lock_study(db, slug).id
        found = unrecorded(db, study_id)
        for trial, candidate in found:
            requests.ask(
                db,
                study_id=study_id,
                candidate=candidate,
                environment=candidate.environment,
                reason=requests.ACQUIRED,
                priority=PRIORITY,
                trial_id=trial.id,
                now=app.now(),
                seed=_run_seed(trial.seed, candidate.candidate_index),
            )
        if found:
            audit_log.note(
                db, app.now(), actor, "recordings of results asked for", slug, rollouts=len(found)
            )
        return len(found)


def _run_seed(trial_seed: int, candidate_index: int) -> int:
    """The seed that a machine is given, below 2^53."""
    sequence = np.random.SeedSequence([trial_seed, _DRAW, candidate_index])
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(11))
