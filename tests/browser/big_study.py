"""A study with many sessions, put into the database directly: to measure and look at pages."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from typing import Any

import numpy as np
from sqlalchemy import insert, select

from app.pbbo import ENGINE_VERSION
from app.services.context import AppContext
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import (
    Acquired,
    Candidate,
    Event,
    Participant,
    PreferenceRow,
    QueryRow,
    Recording,
    Response,
    SessionRow,
    Trial,
)

#: How far the sessions come, over and over: most complete, some leave, some are under way.
STAGES = ("completed",) * 7 + ("query", "withdrawn", "consent")
MINUTES_PER_SESSION = 38


def fill(app: AppContext, study: StudyInfo, sessions: int, seed: int = 1) -> None:
    """Sessions of every condition in turn, each with all its queries unless it ends before."""
    rng = np.random.default_rng(seed)
    with app.database.write() as db:
        clips: dict[str, dict[int, list[int]]] = {}
        scores: dict[str, dict[int, float]] = {}
        for environment, index, recording, score in db.execute(
            select(Candidate.environment, Candidate.candidate_index, Recording.id, Recording.score)
            .join(Recording, Recording.candidate_id == Candidate.id)
            .where(Candidate.study_id == study.id)
        ):
            clips.setdefault(environment, {}).setdefault(index, []).append(recording)
            scores.setdefault(environment, {})[index] = score or 0.0
        made: dict[Any, list[dict[str, Any]]] = {
            kind: []
            for kind in (
                Participant,
                SessionRow,
                Trial,
                QueryRow,
                Response,
                PreferenceRow,
                Acquired,
                Event,
            )
        }
        for number in range(1, sessions + 1):
            _one(app, study, number, rng, clips, scores, made)
        for kind, rows in made.items():
            for at in range(0, len(rows), 5_000):
                db.execute(insert(kind), rows[at : at + 5_000])


def _one(
    app: AppContext,
    study: StudyInfo,
    number: int,
    rng: np.random.Generator,
    clips: dict[str, dict[int, list[int]]],
    scores: dict[str, dict[int, float]],
    made: dict[Any, list[dict[str, Any]]],
) -> None:
    plan = study.plan
    stage = STAGES[number % len(STAGES)]
    started = app.now() - timedelta(minutes=MINUTES_PER_SESSION + 9 * number)
    ended = started + timedelta(minutes=MINUTES_PER_SESSION + float(rng.normal(0, 5)))
    order = [(number + place) % plan.trials for place in range(plan.trials)]
    order = [place // plan.trials_per_condition for place in order]
    lasting = {"completed": plan.trials, "query": 2, "withdrawn": 1, "consent": 0}[stage]
    lasting = min(lasting, plan.trials)
    made[Participant].append(
        {"id": number, "study_id": study.id, "pseudonym": f"p{number:05d}", "created_at": started}
    )
    made[SessionRow].append(
        {
            "id": number,
            "public_id": f"s{number:05d}",
            "study_id": study.id,
            "plan_id": study.plan_id,
            "participant_id": number,
            "token_hash": f"{number:064x}",
            "mode": "live",
            "language": plan.default_language,
            "seed": number,
            "order_index": 0,
            "trial_conditions": order,
            "stage": stage,
            "trial_index": lasting if stage == "completed" else max(lasting - 1, 0),
            "query_index": 5 if stage == "query" else 0,
            "consent_version": None if stage == "consent" else "1",
            "consented_at": None if stage == "consent" else started,
            "watched": [],
            "started_at": started,
            "last_seen_at": ended if stage == "completed" else app.now(),
            "ended_at": ended if stage in ("completed", "withdrawn") else None,
            "expires_at": started + timedelta(days=14),
        }
    )
    for trial_index in range(lasting):
        condition = plan.conditions[order[trial_index]]
        trial_id = number * 100 + trial_index
        finished = stage == "completed" or trial_index + 1 < lasting
        made[Trial].append(
            {
                "id": trial_id,
                "session_id": number,
                "trial_index": trial_index,
                "condition": condition.name,
                "method": condition.method,
                "environment": condition.environment,
                "seed": trial_id,
                "started_at": started,
                "ended_at": ended if finished else None,
            }
        )
        asked = plan.shown_per_trial if finished else 5
        for row in _queries(asked, number, trial_id, trial_index, rng, scores, condition):
            _store(row, clips[condition.environment], started, rng, made)


def _queries(
    asked: int,
    number: int,
    trial_id: int,
    trial_index: int,
    rng: np.random.Generator,
    scores: dict[str, dict[int, float]],
    condition: Any,
) -> Iterator[dict[str, Any]]:
    of = scores[condition.environment]
    best = int(rng.integers(len(of)))
    for query in range(asked):
        left, right = (int(index) for index in rng.choice(len(of), 2, replace=False))
        better = left if of[left] + rng.normal(0, 8) > of[right] else right
        skip = condition.skip is not None and rng.random() < 0.12
        best = better if of[better] > of[best] or rng.random() < 0.05 else best
        yield {
            "session": number,
            "trial_id": trial_id,
            "trial_index": trial_index,
            "query": query,
            "left": left,
            "right": right,
            "response": "skip" if skip else ("left" if better == left else "right"),
            "best": best,
            "fast": number % 17 == 0,
        }


def _store(
    row: dict[str, Any],
    clips: dict[int, list[int]],
    started: Any,
    rng: np.random.Generator,
    made: dict[Any, list[dict[str, Any]]],
) -> None:
    key = row["trial_id"] * 1_000 + row["query"]
    at = started + timedelta(seconds=20 * row["query"])
    made[QueryRow].append(
        {
            "id": key,
            "public_id": f"q{key}",
            "trial_id": row["trial_id"],
            "query_index": row["query"],
            "attempt": 0,
            "trial_type": "model" if row["query"] > 9 else "random",
            "left_candidate": row["left"],
            "right_candidate": row["right"],
            "left_recording_id": clips[row["left"]][0],
            "right_recording_id": clips[row["right"]][0],
            "acquisition": "thompson",
            "seed": row["trial_id"],
            "engine_version": ENGINE_VERSION,
            "created_at": at,
            "shown_at": at,
        }
    )
    rt_ms = 700.0 if row["fast"] else float(2_500 + rng.gamma(2.0, 2_000))
    made[Response].append(
        {
            "query_id": key,
            "response": row["response"],
            "rt_ms": rt_ms,
            "answered_at": at + timedelta(milliseconds=rt_ms),
        }
    )
    if row["response"] != "skip":
        pair = (row["left"], row["right"])
        winner, loser = pair if row["response"] == "left" else pair[::-1]
        made[PreferenceRow].append(
            {
                "trial_id": row["trial_id"],
                "preference_index": row["query"],
                "winner": winner,
                "loser": loser,
                "origin": "answer",
                "query_index": row["query"],
            }
        )
    made[Acquired].append(
        {
            "trial_id": row["trial_id"],
            "query_index": row["query"],
            "candidate": row["best"],
            "posterior_mean": 1.0,
            "posterior_std": 0.5,
        }
    )
    made[Event] += [
        {
            "session_id": row["session"],
            "trial_index": row["trial_index"],
            "query_index": row["query"],
            "event": event,
            "side": side,
            "time_ms": 5_000.0,
            "value": value,
        }
        for event, side, value in (
            ("shown", None, None),
            ("visible", None, None),
            ("start_skew", None, "12"),
            ("watched", "left", f"{rng.uniform(0.6, 1):.3f}"),
            ("watched", "right", f"{rng.uniform(0.6, 1):.3f}"),
            ("width", "left", "640"),
            ("width", "right", "640"),
            ("dropped_frames", "left", "0"),
            ("dropped_frames", "right", "0"),
            ("worst_drift", None, "20"),
        )
    ]
