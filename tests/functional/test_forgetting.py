"""What one server remembers of a person whom another server, a worker or a command has deleted."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from app.main import create_app
from app.services import forgetting, periodic_tasks, withdrawal
from app.services.foreseen import StepCache
from app.services.proposals import TrialInHand
from app.services.settings import Settings
from app.services.studies import StudyInfo
from app.services.studio import Studio, open_studio
from app.services.thoughts import History
from tests.conftest import Clock, Idle

from .client import Api, Session


@pytest.fixture
def elsewhere(settings: Settings, studio: Studio, clock: Clock) -> Iterator[Studio]:
    """Another process's studio over the same database."""
    other = open_studio(settings, now=clock.now, background=Idle(1))
    yield other
    other.close()


@pytest.fixture
def person(client: Api, learning_study: StudyInfo) -> Session:
    """Somebody who has answered here."""
    session = client.start().to_first_query()
    for _ in range(3):
        session.respond("left")
    return session


def histories(studio: Studio) -> dict[int, list[History]]:
    foreseen = studio.proposer._steps
    assert isinstance(foreseen, StepCache)
    kept = foreseen._trials
    return {seed: list(trial.steps) for seed, trial in kept.items()}


def delete_elsewhere(elsewhere: Studio, person: Session) -> None:
    withdrawal.withdraw_and_delete(elsewhere, person.token)


def test_what_was_deleted_elsewhere_is_forgotten_and_nothing_else(
    client: Api, studio: Studio, elsewhere: Studio, person: Session
) -> None:
    # The trial in hand; its belief too, as somebody has looked at it.
    (seed,) = studio.proposer.cached_seeds()
    points = np.linspace(0, 1, 9)[:, None]
    studio.proposer.posteriors.posterior(points, "pbpo", {}, seed, ((0, 1, "left"),))
    another = client.start().to_first_query()
    another.respond("right")
    before = histories(studio)
    assert forgetting.forget_deleted(studio) == 0
    assert histories(studio) == before

    delete_elsewhere(elsewhere, person)
    assert seed in studio.proposer.cached_seeds()
    assert forgetting.forget_deleted(studio) == 1
    assert histories(studio) == {one: steps for one, steps in before.items() if one != seed}
    assert seed not in studio.proposer.cached_seeds()
    assert another.respond("left").status_code == 200


def test_what_was_under_way_meanwhile_is_forgotten_the_next_time(
    studio: Studio, elsewhere: Studio, person: Session, learning_study: StudyInfo
) -> None:
    (seed,) = studio.proposer.cached_seeds()
    delete_elsewhere(elsewhere, person)
    forgetting.forget_deleted(studio)
    trial = TrialInHand(learning_study.id, "env1", "pbpo", {"preset": "paper-env1"}, seed, 5)
    studio.proposer.step(trial, ((0, 1, "left"),))
    assert forgetting.forget_deleted(studio) == 1
    assert studio.proposer.cached_seeds() == frozenset()


def test_a_trial_that_is_just_beginning_loses_nothing_for_good(
    client: Api, studio: Studio, short_study: StudyInfo
) -> None:
    session = client.start()
    session.consent()
    # The first pair is worked out, and its trial not stored yet.
    assert forgetting.forget_deleted(studio) == 1
    session.to_first_query().respond("left")
    assert any(map(any, histories(studio).values()))


def test_a_server_forgets_by_itself_as_long_as_it_runs(
    studio: Studio,
    elsewhere: Studio,
    person: Session,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    often = tuple(replace(task, period_s=0.01) for task in periodic_tasks.OF_EACH_PROCESS)
    monkeypatch.setattr(periodic_tasks, "OF_EACH_PROCESS", often)
    server = create_app(studio=studio)

    async def run() -> None:
        async with server.router.lifespan_context(server):
            # A fault is no end of it.
            with monkeypatch.context() as broken:
                broken.setattr(studio.proposer, "cached_seeds", None)
                await asyncio.sleep(0.05)
            delete_elsewhere(elsewhere, person)
            deadline = time.monotonic() + 30
            while studio.proposer.cached_seeds() and time.monotonic() < deadline:
                await asyncio.sleep(0.01)

    asyncio.run(run())
    assert studio.proposer.cached_seeds() == frozenset()
