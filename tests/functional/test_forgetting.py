"""What one server remembers of a person whom another server, a worker or a command has deleted."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from app.main import create_app
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.maintenance import evict_deleted_trials, periodic_tasks
from app.services.proposals.computation import History
from app.services.proposals.proposer import TrialSpec
from app.services.proposals.step_cache import StepCache
from app.services.runtime.settings import Settings
from app.services.sessions import withdrawal
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock, Idle

from .client import Api, Session


@pytest.fixture
def elsewhere(settings: Settings, app: AppContext, clock: Clock) -> Iterator[AppContext]:
    """Another process's studio over the same database."""
    other = open_app(settings, now=clock.now, background=Idle(1))
    yield other
    other.close()


@pytest.fixture
def person(client: Api, learning_study: StudyInfo) -> Session:
    """Somebody who has answered here."""
    session = client.start().to_first_query()
    for _ in range(3):
        session.respond("left")
    return session


def histories(app: AppContext) -> dict[int, list[History]]:
    foreseen = app.proposer._steps
    assert isinstance(foreseen, StepCache)
    kept = foreseen._trials
    return {seed: list(trial.steps) for seed, trial in kept.items()}


def delete_elsewhere(elsewhere: AppContext, person: Session) -> None:
    withdrawal.withdraw_and_delete(elsewhere, person.token)


def test_what_was_deleted_elsewhere_is_forgotten_and_nothing_else(
    client: Api, app: AppContext, elsewhere: AppContext, person: Session
) -> None:
    # The trial in hand; its belief too, as somebody has looked at it.
    (seed,) = app.proposer.cached_seeds()
    points = np.linspace(0, 1, 9)[:, None]
    app.proposer.posteriors.posterior(points, "pbpo", {}, seed, ((0, 1, "left"),))
    another = client.start().to_first_query()
    another.respond("right")
    before = histories(app)
    assert evict_deleted_trials.evict_deleted(app) == 0
    assert histories(app) == before

    delete_elsewhere(elsewhere, person)
    assert seed in app.proposer.cached_seeds()
    assert evict_deleted_trials.evict_deleted(app) == 1
    assert histories(app) == {one: steps for one, steps in before.items() if one != seed}
    assert seed not in app.proposer.cached_seeds()
    assert another.respond("left").status_code == 200


def test_what_was_under_way_meanwhile_is_forgotten_the_next_time(
    app: AppContext, elsewhere: AppContext, person: Session, learning_study: StudyInfo
) -> None:
    (seed,) = app.proposer.cached_seeds()
    delete_elsewhere(elsewhere, person)
    evict_deleted_trials.evict_deleted(app)
    trial = TrialSpec(learning_study.id, "env1", "pbpo", {"preset": "paper-env1"}, seed, 5)
    app.proposer.step(trial, ((0, 1, "left"),))
    assert evict_deleted_trials.evict_deleted(app) == 1
    assert app.proposer.cached_seeds() == frozenset()


def test_a_trial_that_is_just_beginning_loses_nothing_for_good(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    session = client.start()
    session.consent()
    # The first pair is worked out, and its trial not stored yet.
    assert evict_deleted_trials.evict_deleted(app) == 1
    session.to_first_query().respond("left")
    assert any(map(any, histories(app).values()))


def test_a_server_forgets_by_itself_as_long_as_it_runs(
    app: AppContext,
    elsewhere: AppContext,
    person: Session,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    often = tuple(replace(task, period_s=0.01) for task in periodic_tasks.OF_EACH_PROCESS)
    monkeypatch.setattr(periodic_tasks, "OF_EACH_PROCESS", often)
    server = create_app(app=app)

    async def run() -> None:
        async with server.router.lifespan_context(server):
            # A fault is no end of it.
            with monkeypatch.context() as broken:
                broken.setattr(app.proposer, "cached_seeds", None)
                await asyncio.sleep(0.05)
            delete_elsewhere(elsewhere, person)
            deadline = time.monotonic() + 30
            while app.proposer.cached_seeds() and time.monotonic() < deadline:
                await asyncio.sleep(0.01)

    asyncio.run(run())
    assert app.proposer.cached_seeds() == frozenset()
