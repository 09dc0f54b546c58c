"""What simulated evaluators see of recordings: scores, their scale, and machines at work.

The recordings of a list exist, with their scores, before a simulation begins. Those of a machine
are made while it goes on: the crane inside the server works within this process, and a machine
outside is waited for.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike
from sqlalchemy import select

from app.crane import library
from app.lab.session_bot import LOOK_EVERY_S
from app.lab.session_people import ScoredRecording, SessionPerson
from app.services.background.local import LocalBackground
from app.services.context import AppContext, utc_now
from app.services.rollouts import crane_machine
from app.services.runtime.errors import ConflictError
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import Candidate, Recording

#: Seconds for which a pair may wait while no machine is connected.
MACHINE_MISSED_S: Final = 60.0

_NO_SCORE: Final = (
    "expected a score for every recording, since simulated evaluators answer from them"
)


@dataclass(frozen=True)
class Scale:
    """Mean and standard deviation of scores: what simulated evaluators expect of a video.

    mean: None, and spread: 0, before there is a score.
    """

    mean: float | None
    spread: float

    @classmethod
    def of(cls, scores: ArrayLike) -> Self:
        """That of these scores."""
        values = np.asarray(scores, dtype=np.float64)
        return cls(float(values.mean()), float(values.std())) if values.size else cls(None, 0.0)


class Scores:
    """The scores of a study's recordings, those included that machines make meanwhile.

    Raises ConflictError if a recording has no score.
    """

    def __init__(self, app: AppContext, study: StudyInfo) -> None:
        self._app = app
        self._study = study
        self._recordings = self._read()
        self._judged: Mapping[int, float] | None = None

    @property
    def recordings(self) -> list[ScoredRecording]:
        """All that exist, by key."""
        return list(self._recordings.values())

    def require_all_recorded(self) -> None:
        """Raise ConflictError if machines record what is shown."""
        if self._study.plan.has_ranges:
            raise ConflictError(
                "expected a study whose recordings exist, since people's tastes are drawn for them"
            )

    def as_judged_by(self, person: SessionPerson) -> None:
        """Give this person's own scores from now on."""
        self._judged = person.scores

    def of(self, url: str) -> float:
        """The score of the recording at this address, which a session was given."""
        shown = self._app.addresses.opened(PurePosixPath(url).stem)
        assert shown is not None
        if self._judged is not None:
            return self._judged[shown.recording_id]
        if shown.recording_id not in self._recordings:
            self._recordings = self._read()
        return self._recordings[shown.recording_id].score

    def scale(self) -> Scale:
        """The scale by which an evaluator judges who begins now.

        Of a list it is that of all recordings. Machines have recorded nothing at first: the crane
        inside the server is judged by its published runs, others by their runs so far.
        """
        if self._study.plan.has_ranges:
            environments = {one.environment for one in self._study.plan.conditions}
            if all(self._study.plan.environments[one].is_crane_machine for one in environments):
                return Scale.of([library.scores(one) for one in sorted(environments)])
            self._recordings = self._read()
        return Scale.of([one.score for one in self._recordings.values()])

    def _read(self) -> Mapping[int, ScoredRecording]:
        with self._app.database.read() as db:
            rows = db.execute(
                select(Recording.id, Recording.score, Candidate)
                .join(Candidate, Recording.candidate_id == Candidate.id)
                .where(Candidate.study_id == self._study.id)
                .order_by(Recording.id)
            ).all()
        scored = {
            key: ScoredRecording(
                key,
                candidate.environment,
                candidate.candidate_index,
                tuple(float(value) for value in candidate.parameters.values()),
                score,
            )
            for key, score, candidate in rows
            if score is not None
        }
        if len(scored) < len(rows):
            raise ConflictError(_NO_SCORE)
        return scored


class Machines:
    """Lets machines record what an evaluator waits for."""

    def __init__(self, app: AppContext) -> None:
        # A machine's leases end by the true time, whatever the evaluators' clock says.
        self._app = replace(app, background=LocalBackground(1), now=utc_now)
        self._missed_since: float | None = None

    async def work(self, waiting: Mapping[str, Any]) -> None:
        """Let the crane record one rollout, or else wait a moment. waiting: that of STATE.

        Raises ConflictError if no machine has been connected for MACHINE_MISSED_S.
        """
        if await asyncio.to_thread(crane_machine.work_once, self._app):
            self._missed_since = None
            return
        now = time.monotonic()
        if waiting["machines"]:
            self._missed_since = None
        elif self._missed_since is None:
            self._missed_since = now
        elif now - self._missed_since > MACHINE_MISSED_S:
            raise ConflictError(
                "expected a machine that records the next pair, and none has been connected for"
                f" {MACHINE_MISSED_S:g} s: start one (pbpo machine add)"
            )
        await asyncio.sleep(LOOK_EVERY_S)

    def close(self) -> None:
        """End the processes that recorded."""
        self._app.background.close()
