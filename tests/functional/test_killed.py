"""A server killed in the middle of a session: nothing answered is lost, and nobody notices."""

from __future__ import annotations

import io
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import httpx
import pandas as pd
import pytest

from app.main import create_app
from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository
from tests.conftest import Idle

from .client import Api, Session
from .conftest import EMAIL, PASSWORD
from .own_study import write_own_study
from .served import Served

State = dict[str, Any]


#: Whether certificates are: they would be read anew for each call, which takes longer than that.
CHECKED: Final = False


class Browser:
    """An evaluator's browser: it keeps its token while servers come and go."""

    def __init__(self, url: str) -> None:
        started = httpx.post(
            f"{url}/api/v1/studies/kettles/sessions", json={}, verify=CHECKED
        ).json()
        self.token: str = started["token"]
        self._headers = {"Authorization": f"Bearer {self.token}"}
        self.state: State = started["session"]

    def look(self, url: str) -> State:
        self.state = httpx.get(
            f"{url}/api/v1/session", headers=self._headers, verify=CHECKED
        ).json()
        return self.state

    def send(self, url: str, step: str, body: State | None = None) -> int:
        address = f"{url}/api/v1/session/{step}"
        response = httpx.post(address, json=body, headers=self._headers, verify=CHECKED)
        if response.status_code == 200:
            self.state = response.json()
        return response.status_code

    def body(self, response: str) -> State:
        return {"query_id": self.state["query"]["id"], "response": response, "rt_ms": 1500}

    def to_first_query(self, url: str) -> None:
        self.send(url, "consent", {"version": self.state["consent"]["version"]})
        while self.state["stage"] != "query":
            assert self.send(url, "continue") == 200


def videos(url: str, state: State) -> list[bytes]:
    return [httpx.get(url + state["query"][side]["url"]).content for side in ("left", "right")]


def queries(url: str, api_token: str) -> pd.DataFrame:
    table = httpx.get(
        f"{url}/api/v1/studies/kettles/export/queries.csv",
        headers={"Authorization": f"Bearer {api_token}"},
    )
    return read(table)


def read(table: httpx.Response) -> pd.DataFrame:
    return pd.read_csv(io.BytesIO(table.content))


@pytest.fixture
def token(tmp_path: Path, media_dir: Path) -> str:
    """A data folder with an open study in it, and an experimenter's token."""
    folder = write_own_study(tmp_path / "kettles")
    settings = Settings(data_dir=tmp_path / "data", media_dir=media_dir)
    app = open_app(settings, background=Idle(1))
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, "kettles")
    token = accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "tests")
    app.close()
    return token


def test_an_evaluator_goes_on_at_the_very_query_after_the_server_was_killed(
    tmp_path: Path, media_dir: Path, token: str
) -> None:
    data_dir = tmp_path / "data"
    with Served("serve", data_dir, media_dir) as first:
        browser = Browser(first.url)
        browser.to_first_query(first.url)
        for response in ("left", "right"):
            assert browser.send(first.url, "responses", browser.body(response)) == 200
        before, seen = browser.look(first.url), videos(first.url, browser.state)
        first.kill()

    with Served("serve", data_dir, media_dir) as second:
        after = browser.look(second.url)
        for part in ("id", "left", "right", "skip"):
            assert after["query"][part] == before["query"][part]
        assert after["progress"] == before["progress"] == {**before["progress"], "query": 3}
        assert videos(second.url, after) == seen
        assert queries(second.url, token)["response"].dropna().to_list() == ["left", "right"]

        # Killed while a response is on its way: it was stored or it was not, never by halves.
        body = browser.body("left")
        on_its_way = threading.Thread(target=_send_into_the_dark, args=(browser, second, body))
        on_its_way.start()
        time.sleep(0.01)
        second.kill()
        on_its_way.join()

    app = open_app(Settings(data_dir=data_dir, media_dir=media_dir), background=Idle(1))
    # A new process has nothing in memory, and a response may be the first request that it gets.
    for kept in (repository.stored_plan, repository.stored_texts):
        kept.cache_clear()
    with Api(create_app(app=app)) as third:
        db = Session(third, browser.token, browser.state)
        assert db.call("responses", body).status_code == 200
        db.to_the_end(lambda _: "right", lambda _: None)
        address = "/api/v1/studies/kettles/export/queries.csv"
        answered = read(third.get(address, headers={"Authorization": f"Bearer {token}"}))
    app.close()
    assert answered["response"].to_list() == ["left", "right", "left", *["right"] * 5]
    assert answered["trial_index"].to_list() == [0] * 4 + [1] * 4
    assert answered["query_index"].to_list() == [0, 1, 2, 3] * 2


def _send_into_the_dark(browser: Browser, server: Served, body: State) -> None:
    with suppress(httpx.TransportError):
        browser.send(server.url, "responses", body)
