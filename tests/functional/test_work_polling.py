"""Machines that wait for work: many on one process, woken when there is some."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import httpx
import pytest
from fastapi import FastAPI
from starlette.concurrency import run_in_threadpool

from app.services.context import AppContext
from app.services.rollouts import machines
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.web.api.work_polling import WorkPolling
from tests.conftest import StudyShelf

from .client import Api
from .machine_study import ROBOT_PLAN, add_candidates, ask

MACHINES = 30
CLAIM = "/api/v1/studies/robot/rollouts/claim"


@pytest.fixture
def study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, ROBOT_PLAN)
    return repository.find(app, "robot")


async def _until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(60):
        while not holds():
            await asyncio.sleep(0.01)


def test_waiting_machines_hold_no_thread_and_get_what_is_asked_later(
    app: AppContext, application: FastAPI, client: Api, study: StudyInfo
) -> None:
    candidates = add_candidates(app, study.slug)
    tokens = [machines.add(app, study.slug, f"m{number}") for number in range(MACHINES)]
    polling: WorkPolling = application.state.work_polling

    async def scene(http: httpx.AsyncClient) -> list[httpx.Response]:
        calls = [
            asyncio.create_task(
                http.post(
                    CLAIM,
                    json={"wait_s": 50},
                    headers={"Authorization": f"Bearer {token}"},
                    timeout=120,
                )
            )
            for token in tokens
        ]
        await _until(lambda: polling.number(study.id) == MACHINES)
        # More of them wait than there are threads for machines; evaluators are served meanwhile.
        answer = await http.get("/readyz")
        assert answer.status_code == 200
        for candidate in candidates[:MACHINES]:
            await run_in_threadpool(ask, app, candidate)
        return list(await asyncio.gather(*calls))

    answers = client.run(scene)
    assert [answer.status_code for answer in answers] == [200] * MACHINES
    assert len({answer.json()["id"] for answer in answers}) == MACHINES
    assert polling.number(study.id) == 0


def test_one_rollout_wakes_one_machine_and_the_others_wait_on(
    app: AppContext, application: FastAPI, client: Api, study: StudyInfo
) -> None:
    candidate = add_candidates(app, study.slug)[0]
    tokens = [machines.add(app, study.slug, f"m{number}") for number in range(3)]
    polling: WorkPolling = application.state.work_polling

    async def scene(http: httpx.AsyncClient) -> list[int]:
        calls = [
            asyncio.create_task(
                http.post(CLAIM, json={"wait_s": 4}, headers={"Authorization": f"Bearer {token}"})
            )
            for token in tokens
        ]
        await _until(lambda: polling.number(study.id) == 3)
        await run_in_threadpool(ask, app, candidate)
        return sorted(answer.status_code for answer in await asyncio.gather(*calls))

    assert client.run(scene) == [200, 204, 204]


def test_a_machine_that_is_revoked_while_it_waits_gets_nothing(
    app: AppContext, application: FastAPI, client: Api, study: StudyInfo
) -> None:
    candidate = add_candidates(app, study.slug)[0]
    token = machines.add(app, study.slug, "arm")
    polling: WorkPolling = application.state.work_polling

    async def scene(http: httpx.AsyncClient) -> httpx.Response:
        call = asyncio.create_task(
            http.post(
                CLAIM,
                json={"wait_s": 50},
                headers={"Authorization": f"Bearer {token}"},
                timeout=120,
            )
        )
        await _until(lambda: polling.number(study.id) == 1)
        await run_in_threadpool(machines.revoke, app, study.slug, "arm")
        await run_in_threadpool(ask, app, candidate)
        return await call

    assert client.run(scene).status_code == 401


def test_a_server_that_is_told_to_stop_sends_waiting_machines_away(
    app: AppContext, application: FastAPI, client: Api, study: StudyInfo
) -> None:
    token = machines.add(app, study.slug, "arm")
    polling: WorkPolling = application.state.work_polling

    async def scene(http: httpx.AsyncClient) -> httpx.Response:
        call = asyncio.create_task(
            http.post(
                CLAIM,
                json={"wait_s": 50},
                headers={"Authorization": f"Bearer {token}"},
                timeout=120,
            )
        )
        await _until(lambda: polling.number(study.id) == 1)
        application.state.stopping = lambda: True
        # Sooner than the machine's own time is over.
        async with asyncio.timeout(45):
            return await call

    assert client.run(scene).status_code == 204
