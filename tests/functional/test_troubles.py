"""What fails while people take part is told on the study's page, in plain words."""

from __future__ import annotations

import re
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from datetime import timedelta
from typing import Any

import pytest
from sqlalchemy import func, select
from sqlalchemy.exc import OperationalError

from app.services.accounts.accounts import Role
from app.services.background.interface import Queue
from app.services.context import AppContext
from app.services.failure_counter import FailureContext, FailureCounter, Kind
from app.services.monitoring.change_token import change_token
from app.services.monitoring.incidents import incidents
from app.services.recordings.recordings import Recordings
from app.services.sessions import advance
from app.services.studies.repository import StudyInfo
from app.storage.models.records import FaultCount, Job
from app.storage.models.studies import QueryRow
from app.web.evaluator import media
from tests.conftest import Clock

from .client import Api
from .desk import Desk

DAY = 24 * 3600.0
SHORT = FailureContext(slug="short")


@pytest.fixture
def desk(short_study: StudyInfo, client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "ada@lab.example", Role.ADMIN)


def told(desk: Desk) -> dict[str, str]:
    """What the study's page says of each kind of fault."""
    page = desk.get("/studies/short").text
    found = re.findall(r'<li data-trouble="([\w-]+)">(.*?)</li>', page, re.DOTALL)
    return {kind: " ".join(re.sub("<[^>]+>", " ", said).split()) for kind, said in found}


@contextmanager
def failing(monkeypatch: pytest.MonkeyPatch, error: Exception) -> Iterator[None]:
    """Whoever asks where a session is meets this error."""

    def fail(*_: Any) -> Any:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(advance, "current", fail)
        yield


def test_a_page_and_a_call_that_fail_are_told_with_how_often_when_and_what_to_do(
    desk: Desk, client: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told(desk) == {}
    session = client.start()
    client.cookies.set("pbpo_session_short", session.token)
    with failing(monkeypatch, RuntimeError("not for their eyes")):
        for _ in range(2):
            assert client.get("/s/short").status_code == 500
        # The server's outermost layer makes an answer of it.
        with pytest.raises(RuntimeError):
            client.get("/api/v1/session", headers=session.headers)
    said = told(desk)
    assert said.keys() == {"page", "call"}
    assert said["page"].startswith("2 pages of participants failed.")
    assert "Last: 2026-03-01 09:00" in said["page"]
    assert said["call"].startswith("One request of participants failed.")
    assert "The server's log says why" in said["call"].replace("&#39;", "'")
    assert "not for their eyes" not in desk.get("/studies/short").text


def test_a_database_that_is_away_is_told_once_it_is_back(
    desk: Desk, client: Api, monkeypatch: pytest.MonkeyPatch, app: AppContext
) -> None:
    session = client.start()
    away = OperationalError("SELECT 1", {}, Exception("disk is full"))

    def refuse(_: Any) -> Any:
        raise away

    with failing(monkeypatch, away), monkeypatch.context() as patch:
        patch.setattr(type(app.database), "write", refuse)
        answer = client.get("/api/v1/session", headers=session.headers)
        assert answer.status_code == 503
    said = told(desk)
    assert said["database"].startswith("One request came while the database was full")
    # What was kept in memory meanwhile is written once.
    assert told(desk) == said


def test_a_video_that_cannot_be_made_is_told(
    desk: Desk, client: Api, app: AppContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = client.start().to_first_query().state["query"]["left"]["url"]

    def fail(*_: Any, **_more: Any) -> Any:
        raise OSError("no space left on device")

    monkeypatch.setattr(app.recordings, "ensure", fail)
    with pytest.raises(OSError, match="no space left"):
        client.get(url)
    assert told(desk)["video"].startswith("One video could not be sent.")


def test_a_video_that_nobody_makes_is_answered_and_told(
    desk: Desk, client: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(media, "MADE_WITHIN_S", 0.01)
    # As where no worker is: what is asked for waits, and no error says so.
    monkeypatch.setattr(Recordings, "ensure", lambda *_, **_more: Future[None]())
    url = client.start().to_first_query().state["query"]["left"]["url"]
    answer = client.get(url)
    assert answer.status_code == 503
    assert answer.json()["type"] == "urn:pbpo-studio:problem:store-away"
    assert told(desk)["video"].startswith("One video could not be sent.")


def test_that_no_worker_is_there_is_told_for_as_long_as_none_is(
    desk: Desk, client: Api, app: AppContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    for workers in (1, 0):
        monkeypatch.setattr(
            type(app.background), "queue", lambda _, there=workers: Queue(0, 0, there)
        )
        assert ("no-worker" in told(desk)) == (workers == 0)
        ready = client.get("/readyz")
        # Whoever is sent elsewhere for it would find no worker there either.
        assert (ready.status_code, ready.json()["faults"]) == (200, [])
        assert len(ready.json()["warnings"]) == (workers == 0)


def test_a_clock_that_is_behind_what_is_stored_is_told(
    desk: Desk, client: Api, clock: Clock
) -> None:
    client.start()
    clock.forward(-5 * 60)
    assert client.get("/readyz").json()["warnings"] == []
    clock.forward(-1)
    assert client.get("/readyz").json()["warnings"] == [
        "The clock is 5 minutes behind what was stored: it is wrong, or it was before."
    ]
    assert told(desk)["clock"].startswith("The server&#39;s clock is behind")
    clock.forward(-9 * DAY)
    (said,) = client.get("/readyz").json()["warnings"]
    assert said.startswith("The clock is 9 days behind")


def test_newcomers_who_were_turned_away_are_told(desk: Desk, client: Api, app: AppContext) -> None:
    settings = app.settings.model_copy(update={"begun_per_hour": 1})
    object.__setattr__(app, "settings", settings)
    client.cookies.clear()
    client.start()
    assert client.get("/s/short").status_code == 429
    assert client.post("/api/v1/studies/short/sessions", json={}).status_code == 429
    assert told(desk)["crowded"].startswith("2 requests of newcomers")


def test_what_people_and_models_met_is_told_from_what_is_stored(
    desk: Desk, client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    session = client.start().to_first_query()
    session.call("faults", {"query_id": session.state["query"]["id"], "reason": "left: failed"})
    with app.database.write() as writing:
        writing.scalars(select(QueryRow)).first().acquisition = "random-fallback"  # type: ignore[union-attr]
        writing.add(
            Job(
                public_id="j",
                study_id=short_study.id,
                kind="simulate",
                state="failed",
                done=0,
                total=1,
                request={},
                message="its process ended before its time (status -9)",
                created_at=app.now(),
                ended_at=app.now(),
            )
        )
    said = told(desk)
    assert said["set-aside"].startswith("One pair did not play and made way for another.")
    assert said["no-fit"].startswith("One pair had to be drawn at random")
    assert said["job"].startswith(
        "A simulation that was asked for failed: its process ended before its time (status -9)."
    )


def test_what_is_a_persons_own_mistake_is_no_fault(desk: Desk, client: Api) -> None:
    session = client.start()
    assert client.get("/s/short/no-such-page").status_code == 404
    assert session.call("consent", {"version": "old"}).status_code == 409
    assert session.call("responses", {}).status_code == 422
    assert told(desk) == {}


def test_faults_are_told_to_who_may_see_the_data_and_to_nobody_else(
    desk: Desk, client: Api, app: AppContext
) -> None:
    app.failures.count(Kind.PAGE, SHORT)
    reviewer = Desk(client, app, "rev@board.example", Role.REVIEWER)
    answer = reviewer.get("/studies/short")
    assert answer.headers["location"] == "/studies/short/plan"
    assert "went wrong" not in reviewer.get("/studies/short/plan").text
    assert "went wrong" in desk.get("/studies/short").text


def test_counts_are_one_row_an_hour_and_are_gone_after_a_month(
    app: AppContext, short_study: StudyInfo, clock: Clock
) -> None:
    for seconds in (0, 60, 3600):
        clock.forward(seconds)
        app.failures.count(Kind.CALL, SHORT)
    app.failures.write()
    with app.database.read() as db:
        found = db.execute(
            select(FaultCount.number, FaultCount.last_at).order_by(FaultCount.hour)
        ).all()
    assert [number for number, _ in found] == [2, 1]
    assert found[0].last_at == clock.now() - timedelta(hours=1)
    (trouble,) = incidents(app, short_study)
    assert trouble.said.startswith("3 requests")
    clock.forward(7 * DAY)
    assert incidents(app, short_study) == []
    clock.forward(23 * DAY)
    assert app.failures.delete_old() == 2


def test_an_open_page_learns_of_a_fault(app: AppContext, short_study: StudyInfo) -> None:
    before = change_token(app, short_study.id, ["live"], 30)
    app.failures.count(Kind.PAGE, SHORT)
    assert change_token(app, short_study.id, ["live"], 30) != before


def test_a_flood_is_written_once_and_what_belongs_to_no_study_not_at_all(
    app: AppContext, short_study: StudyInfo
) -> None:
    counts = FailureCounter(app.database, app.now)
    for _ in range(50):
        counts.count(Kind.CALL, SHORT)
    with app.database.read() as db:
        assert db.scalar(select(func.sum(FaultCount.number))) == 1
    counts.count(Kind.CALL, FailureContext(slug="gone"))
    counts.count(Kind.VIDEO, FailureContext(recording="gone"))
    counts.write()
    with app.database.read() as db:
        assert db.scalar(select(func.sum(FaultCount.number))) == 50
