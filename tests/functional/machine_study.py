"""A study whose videos a machine records, as rows: candidates of a box, and trials that ask."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from itertools import count

from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.rollouts import requests
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Candidate, Participant, SessionRow, Study, Trial

#: Points of the box: as many as the largest test asks for.
POINTS: Sequence[tuple[float, float]] = [(0.1 * (index // 10), index % 10) for index in range(60)]

_numbers = count(1)


def add_candidates(app: AppContext, slug: str, environment: str = "env1") -> list[int]:
    """Candidates of a box in this study, not recorded yet; the ids of their rows."""
    with app.database.write() as db:
        study = db.query(Study).filter_by(slug=slug).one()
        rows = [
            Candidate(
                study_id=study.id,
                environment=environment,
                candidate_index=1000 + index,
                parameters={"w0": w0, "w1": w1},
                point_key=f"{w0!r},{w1!r}",
            )
            for index, (w0, w1) in enumerate(POINTS)
        ]
        db.add_all(rows)
        db.flush()
        return [row.id for row in rows]


def add_trial(app: AppContext, slug: str) -> int:
    """A trial of a session of its own; the id of its row."""
    number = next(_numbers)
    with app.database.write() as db:
        study = db.query(Study).filter_by(slug=slug).one()
        person = Participant(study_id=study.id, pseudonym=f"P-ROLL-{number}", created_at=app.now())
        session = SessionRow(
            study=study,
            plan=study.plans[-1],
            participant=person,
            public_id=f"rollouts{number}",
            token_hash=f"rollouts{number}",
            mode="live",
            stage="query",
            language="en",
            seed=number,
            order_index=0,
            trial_conditions=[0],
            trial_index=0,
            query_index=0,
            started_at=app.now(),
            last_seen_at=app.now(),
            expires_at=app.now(),
        )
        trial = Trial(
            session=session,
            trial_index=0,
            condition="pbpo",
            method="pbpo",
            environment="env1",
            seed=number,
            started_at=app.now(),
        )
        db.add(trial)
        db.flush()
        return trial.id


def ask(
    app: AppContext,
    candidate_id: int,
    *,
    reason: str = requests.QUERY,
    priority: int = 0,
    trial_id: int | None = None,
) -> str:
    """Ask for a rollout of this candidate; its public id."""
    with app.database.write() as db:
        return ask_in(db, candidate_id, app.now(), reason, priority, trial_id).public_id


def ask_in(
    db: Session,
    candidate_id: int,
    now: datetime,
    reason: str = requests.QUERY,
    priority: int = 0,
    trial_id: int | None = None,
) -> Rollout:
    candidate = db.get_one(Candidate, candidate_id)
    return requests.ask(
        db,
        study_id=candidate.study_id,
        candidate=candidate,
        environment=candidate.environment,
        reason=reason,
        priority=priority,
        trial_id=trial_id,
        now=now,
        seed=7,
    )
