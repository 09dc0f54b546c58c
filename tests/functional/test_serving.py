"""Servers as processes: how they stop, and several workers on one database."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from http.client import HTTPConnection
from pathlib import Path

import httpx
import psutil
import pytest
from sqlalchemy import select

from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.storage.database import Database
from app.storage.models.studies import SessionRow
from tests.conftest import Idle

from .conftest import EMAIL, PASSWORD
from .own_study import write_own_study
from .served import Served
from .test_experimenter_pages import COOKIE
from .test_killed import Browser

TOKEN = "a-token-of-thirty-two-characters!"


def prepare(settings: Settings, folder: Path) -> str:
    """An open study and an account; its sign-in."""
    app = open_app(settings, background=Idle(1))
    repository.create(app, repository.load_folder(str(write_own_study(folder))))
    repository.open_study(app, "kettles")
    accounts.create(app, EMAIL, PASSWORD)
    cookie = accounts.sign_in(app, EMAIL, PASSWORD)
    app.close()
    return cookie


def until(condition: object, what: str) -> None:
    assert callable(condition)
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.05)


def workers_of(served: Served) -> list[psutil.Process]:
    """Both of them."""
    workers = [
        child
        for child in psutil.Process(served.pid).children()
        if "spawn_main" in " ".join(child.cmdline())
    ]
    assert len(workers) == 2
    return workers


class Watcher:
    """A browser with the watching page open: it reads the stream of changes until that ends."""

    def __init__(self, url: str, cookie: str) -> None:
        self.began = threading.Event()
        self.ended_well = False
        self._url = f"{url}/studies/kettles/events"
        self._cookies = {COOKIE: cookie}
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        with httpx.stream("GET", self._url, cookies=self._cookies, timeout=30) as answer:
            for _ in answer.iter_lines():
                self.began.set()
        # A connection that was cut would have raised.
        self.ended_well = True

    def join(self) -> None:
        self._thread.join(30)


def is_open(url: str) -> bool:
    """Whether a server lets anybody new in."""
    try:
        httpx.get(f"{url}/healthz")
    except httpx.TransportError:
        return False
    return True


def test_told_to_stop_it_ends_streams_at_once_and_finishes_what_it_has_begun(
    tmp_path: Path, media_dir: Path
) -> None:
    data_dir = tmp_path / "data"
    settings = Settings(data_dir=data_dir, media_dir=media_dir)
    cookie = prepare(settings, tmp_path / "kettles")
    database = Database(settings.url)
    with Served("serve", data_dir, media_dir) as server:
        browser = Browser(server.url)
        browser.to_first_query(server.url)
        watcher = Watcher(server.url, cookie)
        assert watcher.began.wait(30)
        log = [json.loads(line) for line in server.output.splitlines() if line.startswith("{")]
        assert {"/s/{slug}", "/api/v1/session/consent"} & {line.get("route") for line in log}
        connection = HTTPConnection(httpx.URL(server.url).netloc.decode(), timeout=30)
        headers = {
            "Authorization": f"Bearer {browser.token}",
            "Content-Type": "application/json",
        }
        ending = threading.Thread(target=server.terminate)
        with database.write() as held:
            # Nobody else can write to the session, on SQLite to anything.
            held.scalars(select(SessionRow).with_for_update()).all()
            body = json.dumps(browser.body("left"))
            connection.request("POST", "/api/v1/session/responses", body, headers)
            # It is all there: whoever comes after it is looked at after it.
            assert all(is_open(server.url) for _ in range(2))
            ending.start()
            until(lambda: not is_open(server.url), "nobody new is let in")
        assert connection.getresponse().status == 200
        connection.close()
        ending.join()
        watcher.join()
        # The stream has ended by itself, before the server's patience did.
        assert watcher.ended_well
        assert "graceful shutdown exceeded" not in server.output
    database.close()
    with Served("serve", data_dir, media_dir) as again:
        assert browser.look(again.url)["progress"]["query"] == 2


@pytest.mark.long
@pytest.mark.postgresql
def test_several_workers_serve_one_database_and_count_together(
    tmp_path: Path, media_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data_dir = tmp_path / "data"
    monkeypatch.setenv("PBPO_METRICS_TOKEN", TOKEN)
    cookie = prepare(Settings(data_dir=data_dir, media_dir=media_dir), tmp_path / "kettles")
    with Served("serve", data_dir, media_dir, "--workers", "2") as served:
        workers = workers_of(served)
        people = [Browser(served.url) for _ in range(6)]
        for person in people:
            person.to_first_query(served.url)
            # Each call goes to either worker, and each works ahead for itself.
            until(lambda: person.look(served.url)["query"]["prefetch"], "it was worked out ahead")  # noqa: B023
            assert person.send(served.url, "responses", person.body("left")) == 200

        def counted(what: str) -> float:
            text = httpx.get(
                f"{served.url}/metrics", headers={"Authorization": f"Bearer {TOKEN}"}
            ).text
            # Each number is there once, and is that of all workers.
            assert 'pid="' not in text
            return sum(
                float(line.removeprefix(what))
                for line in text.splitlines()
                if line.startswith(what)
            )

        # Whichever worker is asked, it answers for both.
        assert [counted('pbpo_responses_total{response="left"} ') for _ in range(4)] == [6.0] * 4
        ahead = counted('pbpo_steps_asked_total{worked_out="ahead"} ')
        assert ahead + counted('pbpo_steps_asked_total{worked_out="at once"} ') == 6

        # One that is killed is replaced, and nobody's answer is lost.
        os.kill(workers[0].pid, signal.SIGKILL)
        until(
            lambda: (
                workers[0].pid not in {child.pid for child in psutil.Process(served.pid).children()}
            ),
            "the killed worker went",
        )
        with httpx.Client(transport=httpx.HTTPTransport(retries=5)) as client:
            headers = {"Authorization": f"Bearer {people[0].token}"}
            state = client.get(f"{served.url}/api/v1/session", headers=headers).json()
        assert state["progress"]["query"] == 2

        watcher = Watcher(served.url, cookie)
        assert watcher.began.wait(30)
        assert served.terminate() == 0
        watcher.join()
        assert watcher.ended_well
        assert "graceful shutdown exceeded" not in served.output


@pytest.mark.long
@pytest.mark.postgresql
def test_workers_leave_their_port_and_their_folder_when_their_server_is_killed(
    tmp_path: Path, media_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    with Served("serve", tmp_path / "data", media_dir, "--workers", "2") as served:
        workers = workers_of(served)
        (shared,) = temporary.glob("pbpo-workers-*")
    # The way out of `with` is SIGKILL.
    _, left = psutil.wait_procs(workers, timeout=30)
    assert not left
    until(lambda: not shared.exists(), "the folder went")
    with pytest.raises(httpx.ConnectError):
        httpx.get(served.url)
