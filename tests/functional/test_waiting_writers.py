"""Whoever writes waits for the database while somebody else holds it; who only looks does not."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Iterator
from contextlib import closing

import httpx
import pytest

from app.services.context import AppContext
from app.services.studies.repository import StudyInfo
from app.web.http import concurrency
from tests.conftest import database_file

from .client import Api, Session

pytestmark = pytest.mark.sqlite

#: More than have a place, and more than the server has threads for pages.
RESPONSES, FORMS = 6, 45
#: Long enough on a busy machine; those who write wait for as long as the lock is held.
AT_ONCE_S = 5.0


@pytest.fixture
def lock(app: AppContext, short_study: StudyInfo) -> Iterator[sqlite3.Connection]:
    """Another program's connection; `BEGIN IMMEDIATE` on it keeps every writer waiting."""
    with closing(sqlite3.connect(database_file(app.settings), isolation_level=None)) as other:
        yield other


def respond(http: httpx.AsyncClient, session: Session) -> asyncio.Task[httpx.Response]:
    body = {"query_id": session.state["query"]["id"], "response": "left"}
    return asyncio.create_task(
        http.post("/api/v1/session/responses", json=body, headers=session.headers)
    )


def go_on(http: httpx.AsyncClient, session: Session) -> asyncio.Task[httpx.Response]:
    cookie = {"Cookie": f"pbpo_session_short={session.token}", "Origin": "http://testserver"}
    return asyncio.create_task(http.post("/s/short/continue", headers=cookie))


def test_who_looks_waits_for_nobody_who_writes(client: Api, lock: sqlite3.Connection) -> None:
    writing = [client.start().to_first_query() for _ in range(RESPONSES)]
    looking = client.start().to_first_query()
    leaving = client.start()
    leaving.consent()

    async def scene(http: httpx.AsyncClient) -> list[httpx.Response]:
        lock.execute("BEGIN IMMEDIATE")
        waiting = [respond(http, one) for one in writing]
        waiting += [go_on(http, leaving) for _ in range(FORMS)]
        await asyncio.sleep(0.3)
        for path in ("/api/v1/session", "/s/short"):
            look = http.get(path, headers=looking.headers)
            assert (await asyncio.wait_for(look, AT_ONCE_S)).status_code == 200
        assert not any(one.done() for one in waiting)
        lock.execute("ROLLBACK")
        return await asyncio.gather(*waiting)

    answers = client.run(scene)
    assert [answer.status_code for answer in answers] == [200] * RESPONSES + [303] * FORMS
    assert [one.look()["progress"]["query"] for one in writing] == [2] * RESPONSES


def test_who_has_waited_for_too_long_is_told_so_and_may_send_again(
    client: Api, lock: sqlite3.Connection, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions = [client.start().to_first_query() for _ in range(RESPONSES)]
    monkeypatch.setattr(concurrency, "PATIENCE_S", 0.1)

    async def scene(http: httpx.AsyncClient) -> list[int]:
        lock.execute("BEGIN IMMEDIATE")
        waiting = [respond(http, one) for one in sessions]
        # Those who were told so wait as well: until that is noted in the database.
        await asyncio.sleep(1.5)
        lock.execute("ROLLBACK")
        return [answer.status_code for answer in await asyncio.gather(*waiting)]

    told_so = RESPONSES - concurrency.WRITING
    assert client.run(scene) == [200] * concurrency.WRITING + [503] * told_so
    for one in sessions[concurrency.WRITING :]:
        assert one.respond("left").status_code == 200
