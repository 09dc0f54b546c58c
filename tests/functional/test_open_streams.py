"""Streams of one account: so many and no more, and none outlives the sign-in it was opened by."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

from app.services.accounts import accounts, administration
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.web.http.server_sent_events import MOST_STREAMS
from tests.conftest import SHORT_PLAN, Idle, StudyShelf

from .served import Served

# The server begins before a test has a database of its own, and none of this is about databases.
pytestmark = pytest.mark.sqlite

EVENTS = "/studies/short/events"
PASSWORD = "correct horse battery"
#: A stream looks once a second; this is for a busy machine.
SECONDS_S = 10.0


@pytest.fixture(scope="module")
def at_work(
    tmp_path_factory: pytest.TempPathFactory, media_dir: Path, study_shelf: StudyShelf
) -> Iterator[tuple[AppContext, str]]:
    folder = tmp_path_factory.mktemp("streams")
    app = open_app(Settings(data_dir=folder / "data", media_dir=media_dir), background=Idle(1))
    study_shelf.put_into(app, SHORT_PLAN)
    assert repository.find(app, "short").status == "open"
    accounts.create(app, "root@lab.example", PASSWORD)
    with Served("serve", folder / "data", media_dir) as server:
        yield app, server.url
    app.close()


def signed_in(app: AppContext, url: str, email: str) -> httpx.Client:
    accounts.create(app, email, PASSWORD, accounts.Role.ADMIN)
    return again(app, url, email)


def again(app: AppContext, url: str, email: str) -> httpx.Client:
    cookie = accounts.sign_in(app, email, PASSWORD)
    # A line for each stream.
    return httpx.Client(
        base_url=url,
        cookies={"pbpo_sign_in": cookie},
        timeout=30,
        limits=httpx.Limits(max_connections=None),
    )


def opened(browser: httpx.Client, streams: ExitStack) -> httpx.Response:
    return streams.enter_context(browser.stream("GET", EVENTS))


def seconds_to_its_end(stream: httpx.Response) -> float:
    begun = time.monotonic()
    for _ in stream.iter_raw():
        pass
    return time.monotonic() - begun


def test_an_account_has_ten_streams_open_and_no_more(at_work: tuple[AppContext, str]) -> None:
    app, url = at_work
    with signed_in(app, url, "many@lab.example") as browser, ExitStack() as streams:
        first = ExitStack()
        assert opened(browser, first).status_code == 200
        for _ in range(MOST_STREAMS - 1):
            assert opened(browser, streams).status_code == 200
        refused = browser.get(EVENTS)
        assert refused.status_code == 429
        assert int(refused.headers["retry-after"]) > 0
        # Of another account nothing is taken away.
        with signed_in(app, url, "few@lab.example") as other, ExitStack() as theirs:
            assert opened(other, theirs).status_code == 200

        first.close()
        deadline = time.monotonic() + SECONDS_S
        while (answer := opened(browser, streams)).status_code == 429:
            assert time.monotonic() < deadline
            time.sleep(0.2)
        assert answer.status_code == 200


@pytest.mark.parametrize("how", ["signed out", "disabled"])
def test_a_stream_ends_soon_after_its_sign_in(at_work: tuple[AppContext, str], how: str) -> None:
    app, url = at_work
    email = f"{how.replace(' ', '-')}@lab.example"
    with signed_in(app, url, email) as browser, ExitStack() as streams:
        stream = opened(browser, streams)
        assert stream.status_code == 200
        if how == "signed out":
            accounts.sign_out(app, browser.cookies["pbpo_sign_in"])
        else:
            administration.disable(app, email, "root@lab.example")
        assert seconds_to_its_end(stream) < SECONDS_S
