"""Simulated evaluators through the real application, without waiting for their breaks."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import partial
from typing import Any, Self, TypeVar

import httpx
import numpy as np
from sqlalchemy import select

from app.lab import people_needed
from app.lab.evaluators import Certain, Evaluator, SkipsEqual, Uncertain
from app.lab.session_bot import walk
from app.lab.session_people import SessionPerson, SimulatedPeople, session_person
from app.services.accounts.accounts import Principal, Role
from app.services.background.job_function import JobHandler, ProgressCallback
from app.services.background.local import LocalBackground
from app.services.bootstrap import open_app
from app.services.context import AppContext, utc_now
from app.services.runtime.settings import Settings
from app.services.sessions import simulated_evaluators
from app.services.studies import people_power, repository, simulation_results
from app.storage.database import Database
from app.storage.models.studies import QueryRow, SessionRow, Study, Trial
from app.web.http.security import optional_experimenter

from .main import create_app
from .simulated_recordings import Machines, Scale, Scores

T = TypeVar("T")

#: Steepness of the published evaluator (0.08) times the spread of the published scores (23.4).
ETA_PER_SPREAD = 0.08 * 23.4
#: Two videos are hard to tell apart within this share of the scores' spread: 6 g at the crane,
#: the middle of the five people of app.lab.people.
EQUAL_WITHIN_SPREAD = 6.0 / 23.4
#: The method whose skip button says that a choice is hard.
SKIPS_MEAN_EQUAL = "pbpo-no-synthesis"

#: Nobody takes longer: simulated sessions begin so long before now.
LONGEST_SESSION = timedelta(hours=6)

#: Who starts simulated sessions: whoever runs the command may do everything, account or not.
SIMULATOR = Principal(0, "simulation", Role.ADMIN)


class SkippedClock:
    """A clock that passes over what simulated evaluators would have waited.

    It begins as long ago as a session may take, so that nothing happens in the future.
    """

    def __init__(self, longest: timedelta) -> None:
        self._longest = longest
        self._ahead = -longest

    def now(self) -> datetime:
        return utc_now() + self._ahead

    async def wait(self, seconds: float) -> None:
        self._ahead += timedelta(seconds=seconds)

    def begin_again(self) -> None:
        self._ahead = -self._longest


class NothingAhead(LocalBackground):
    """No work ahead and no videos: a simulated evaluator does not watch, and need not wait."""

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        return Future()

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        return Future()


@dataclass(frozen=True)
class Habits:
    """How the evaluators of a session decide.

    skip_below: they skip, where they may, when both scores lie below it; None: never. eta: the
    steepness of their choices; None: they are certain.
    """

    skip_below: float | None
    equal_within: float
    eta: float | None

    @classmethod
    def by(cls, scale: Scale, kind: str, eta: float | None) -> Self:
        """Those of a kind of evaluator that expects scores of this scale; eta: if it is given."""
        spread = scale.spread if scale.mean is not None else 1.0
        steepness = ETA_PER_SPREAD / max(spread, 1e-12) if eta is None else eta
        return cls(
            scale.mean, EQUAL_WITHIN_SPREAD * spread, steepness if kind == "uncertain" else None
        )

    def evaluator(self, rng: np.random.Generator) -> Evaluator:
        """An evaluator who decides so."""
        if self.eta is None:
            return Certain(self.skip_below)
        return Uncertain(rng, self.skip_below, self.eta)

    def as_json(self) -> dict[str, Any]:
        """As they are stored with a session."""
        eta = {} if self.eta is None else {"eta": self.eta}
        return {"skip_below": self.skip_below, "equal_within": self.equal_within, **eta}


@dataclass(frozen=True)
class Simulated:
    """What came of a simulation, and how its last evaluator decided."""

    completed: int
    habits: Habits
    people: SimulatedPeople | None = None

    def in_words(self) -> str:
        """Sentences on how the evaluators decided."""
        if self.people is not None:
            return (
                f"{self.people.own_share:.0%} of the variance of their taste was their own."
                f" Not reliable were: {', '.join(self.people.unreliable) or 'none'}."
            )
        below, eta = self.habits.skip_below, self.habits.eta
        said = (
            "They never skipped, for want of a score to compare with;"
            if below is None
            else f"They skipped, where they could, when both scores lay below {below:.4g};"
        )
        said += (
            f" under {SKIPS_MEAN_EQUAL}, when the two differed by less than"
            f" {self.habits.equal_within:.4g}."
        )
        if eta is not None:
            said += f" Their choices had a steepness (eta) of {eta:.4g} per unit of score."
        return said


def simulate_job(settings: Settings, request: Mapping[str, Any], report: ProgressCallback) -> str:
    """The work of a job: simulate as many sessions as `request` says; what came of it.

    Begun again after a stop it goes on with those that are still missing.
    """
    slug, sessions = str(request["slug"]), int(request["sessions"])
    there = completed_simulated(settings, slug) - int(request["before"])
    first = min(max(there, 0), sessions)
    done = run(
        settings,
        slug,
        sessions,
        str(request["evaluator"]),
        int(request["seed"]),
        report=report,
        first=first,
    )
    return f"{first + done.completed} simulated sessions were completed. {done.in_words()}"


#: Kinds of job that services may not import: they simulate evaluators.
JOBS: Mapping[str, JobHandler] = {
    simulation_results.SIMULATE: simulate_job,
    people_power.POWER: people_needed.power_job,
}


def completed_simulated(settings: Settings, slug: str) -> int:
    """How many simulated sessions of a study were completed."""
    database = Database(settings.url)
    try:
        with database.read() as db:
            return len(
                db.scalars(
                    select(SessionRow.id)
                    .join(Study, SessionRow.study_id == Study.id)
                    .where(
                        Study.slug == slug,
                        SessionRow.mode == "simulated",
                        SessionRow.stage == "completed",
                    )
                ).all()
            )
    finally:
        database.close()


def run(
    settings: Settings,
    slug: str,
    sessions: int,
    kind: str,
    seed: int,
    eta: float | None = None,
    *,
    report: ProgressCallback = lambda _done, _total: None,
    first: int = 0,
    people: SimulatedPeople | None = None,
) -> Simulated:
    """Walk `sessions` simulated evaluators through a study.

    eta: steepness of the uncertain evaluator, per unit of score; None: one that decides between
    this study's scores as the published one does between the crane's. report: told how many of
    how many are done. first: how many have been done before. people: if given, each evaluator is
    one of these people, whatever `kind` says.
    """
    clock = SkippedClock(LONGEST_SESSION)
    app = open_app(settings, now=clock.now, background=NothingAhead(1))
    try:
        walks = _run(app, clock, slug, range(first, sessions), kind, seed, eta, report, people)
        return asyncio.run(walks)
    finally:
        app.close()


async def _run(
    app: AppContext,
    clock: SkippedClock,
    slug: str,
    indices: range,
    kind: str,
    seed: int,
    eta: float | None,
    report: ProgressCallback,
    people: SimulatedPeople | None,
) -> Simulated:
    scores = Scores(app, repository.find(app, slug))
    if people is not None:
        scores.require_all_recorded()
    done = Simulated(0, Habits.by(scores.scale(), kind, eta), people)
    application = create_app(app=app)
    application.dependency_overrides[optional_experimenter] = lambda: SIMULATOR
    transport = httpx.ASGITransport(application)
    machines = Machines(app)
    try:
        async with httpx.AsyncClient(transport=transport, base_url="http://simulation") as client:
            for index in indices:
                clock.begin_again()
                rng = np.random.default_rng([seed, index])
                done = replace(done, habits=Habits.by(scores.scale(), kind, eta))
                usual = done.habits.evaluator(rng)
                evaluator = {"kind": kind, "seed": seed, "index": index, **done.habits.as_json()}
                if people is not None:
                    one = _person(people, index, scores, seed, eta)
                    usual = one.evaluator
                    scores.as_judged_by(one)
                    told = Habits.by(scores.scale(), "uncertain", eta).as_json()
                    evaluator |= {"kind": "people", "people": people.people, **told, **one.settings}
                state = await walk(
                    client,
                    slug,
                    _by_method(app, usual, SkipsEqual(usual, done.habits.equal_within)),
                    scores.of,
                    mode="simulated",
                    api_token="",
                    wait=clock.wait,
                    recording=machines.work,
                    began=partial(_began, app, evaluator),
                )
                done = replace(done, completed=done.completed + (state["stage"] == "completed"))
                report(index + 1, indices.stop)
    finally:
        machines.close()
    return done


def _person(
    people: SimulatedPeople, index: int, scores: Scores, seed: int, eta: float | None
) -> SessionPerson:
    steepness = ETA_PER_SPREAD if eta is None else eta * scores.scale().spread
    return session_person(people, index, scores.recordings, seed, steepness)


def _began(app: AppContext, evaluator: Mapping[str, Any], token: str) -> None:
    simulated_evaluators.record(app, token, evaluator)


def _by_method(
    app: AppContext, usual: Evaluator, where_hard: Evaluator
) -> Callable[[str], Evaluator]:
    """Who answers a query: `where_hard` under the method whose skip says that a choice is hard."""

    def evaluator_of(query_id: str) -> Evaluator:
        with app.database.read() as db:
            method = db.scalar(
                select(Trial.method)
                .join(QueryRow, QueryRow.trial_id == Trial.id)
                .where(QueryRow.public_id == query_id)
            )
        return where_hard if method == SKIPS_MEAN_EQUAL else usual

    return evaluator_of
