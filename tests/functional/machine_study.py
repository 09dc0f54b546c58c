"""A study whose videos a machine records, as rows: candidates of a box, and trials that ask."""

from __future__ import annotations

import io
from collections.abc import Sequence
from datetime import datetime
from itertools import count
from typing import Any

import av
import httpx
import numpy as np
from av.video.stream import VideoStream
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.rollouts import requests
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Candidate, Participant, SessionRow, Study, Trial

from .client import Api

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


#: A study over ranges, whose videos a machine outside the server records.
ROBOT_PLAN = """
version: 1
slug: robot
title: {en: A robot}
languages: [en]
parameters:
  - {name: w0, label: Opening time, unit: s, min: 0, max: 1}
  - {name: w1, label: Closing time, unit: s, min: 0, max: 10}
environments:
  env1: {source: machine, rollout: {timeout_s: 60, attempts: 2}}
conditions:
  - {name: box, method: pbpo-threshold, environment: env1, skip: {label: {en: Neither}}}
queries_per_trial: 4
"""


def video_bytes(shade: int = 120, codec: str = "libx264", form: str = "mp4") -> bytes:
    """A tiny video of 0.4 s, in one grey."""
    sink = io.BytesIO()
    picture = np.full((32, 32, 3), shade, dtype=np.uint8)
    with av.open(sink, mode="w", format=form) as container:
        stream = container.add_stream(codec, rate=5)
        assert isinstance(stream, VideoStream)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        stream.codec_context.thread_count = 1
        for _ in range(2):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return sink.getvalue()


class Robot:
    """The calls of one machine, with its token."""

    def __init__(self, api: Api, token: str, slug: str = "robot") -> None:
        self.api = api
        self.base = f"/api/v1/studies/{slug}/rollouts"
        self.headers = {"Authorization": f"Bearer {token}"}

    def claim(self, **body: Any) -> httpx.Response:
        return self.post("claim", {"wait_s": 0, **body})

    def claimed(self, **body: Any) -> dict[str, Any]:
        """The rollout that it gets."""
        answer = self.claim(**body)
        assert answer.status_code == 200, answer.text
        found: dict[str, Any] = answer.json()
        return found

    def beat(self, rollout: str, **body: Any) -> httpx.Response:
        return self.post(f"{rollout}/heartbeat", body)

    def failed(self, rollout: str, reason: str = "jammed", **body: Any) -> httpx.Response:
        return self.post(f"{rollout}/failed", {"reason": reason, **body})

    def unsafe(self, rollout: str, reason: str = "too fast") -> httpx.Response:
        return self.post(f"{rollout}/unsafe", {"reason": reason})

    def measure(self, rollout: str, **body: Any) -> httpx.Response:
        return self.post(f"{rollout}/measurements", body)

    def put(self, rollout: str, body: bytes, **more: Any) -> httpx.Response:
        """Upload a recording. more: `attempt`, and headers, with underscores for hyphens."""
        attempt = more.pop("attempt", None)
        return self.api.request(
            "PUT",
            f"{self.base}/{rollout}/recording",
            content=body,
            params={} if attempt is None else {"attempt": attempt},
            headers={**self.headers, **{key.replace("_", "-"): v for key, v in more.items()}},
        )

    def post(self, path: str, body: Any) -> httpx.Response:
        return self.api.post(f"{self.base}/{path}", json=body, headers=self.headers)
