"""What `make load` and `make chaos` hold: that they would see it if something were lost."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer
from sqlalchemy import delete, update

from app.services.context import AppContext
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import QueryRow, Response
from tests.load.crowd import Evaluator, Habits, Log, RefusedError
from tests.load.stored import errors_in, faults_in

from .client import Api


def test_what_was_acknowledged_is_looked_for_and_what_nobody_was_told_of_is_seen(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    told = []
    for response in ("left", "right", "left"):
        told.append((session.state["query"]["id"], response))
        session.respond(response)
    on_its_way = {(session.token, *told[-1])}

    def found(acknowledged: list[tuple[str, str]], *, in_hand: bool = False) -> str:
        log = Log(acknowledged={session.token: acknowledged})
        return "; ".join(faults_in(app, "short", log, on_its_way if in_hand else set()))

    assert found(told) == ""
    assert found(told[:2], in_hand=True) == ""
    assert "1 responses are stored that nobody was told of" in found(told[:2])
    assert "1 acknowledged responses are not stored" in found([*told[:2], (told[2][0], "right")])

    with app.database.write() as row:
        query = QueryRow.public_id == told[0][0]
        left, right = QueryRow.left_candidate, QueryRow.right_candidate
        row.execute(update(QueryRow).where(query).values({left: right, right: left}))
    assert "queries are not what their history says" in found(told)
    with app.database.write() as row:
        row.execute(delete(Response))
    assert "3 acknowledged responses are not stored" in found(told)


def test_a_patient_crowd_forgives_a_server_that_cannot_just_now_and_no_other_fault() -> None:
    log = Log()

    async def asked(status: int) -> dict[str, Any] | None:
        async def answer(_: web.Request) -> web.Response:
            return web.Response(status=status)

        application = web.Application()
        application.router.add_get("/api/v1/session", answer)
        habits = Habits(patient=True)
        async with (
            TestServer(application) as server,
            Evaluator(str(server.make_url("/")), "short", habits, log, 1) as somebody,
        ):
            return await somebody._asked("GET", "/api/v1/session", None)

    assert asyncio.run(asked(503)) is None
    assert log.faults == []
    for number, status in enumerate((500, 502), start=1):
        with pytest.raises(RefusedError):
            asyncio.run(asked(status))
        assert len(log.faults) == number


def test_what_a_servers_log_tells_is_seen_unless_what_was_broken_explains_it(
    tmp_path: Path,
) -> None:
    log = tmp_path / "server.log"
    lines = [
        "Serving at http://127.0.0.1:8000",
        json.dumps({"level": "info", "message": "request", "status": 200}),
        json.dumps({"level": "error", "message": "the database failed", "exception": "locked"}),
        json.dumps({"level": "error", "message": "Exception in ASGI application"}),
        '{"level": "error", "mess',
    ]
    log.write_text("\n".join(lines))
    assert len(errors_in(log)) == 2
    (unexplained,) = errors_in(log, ("the database",))
    assert "Exception in ASGI application" in unexplained
    log.write_text("Traceback (most recent call last):\n")
    assert len(errors_in(log)) == 1
