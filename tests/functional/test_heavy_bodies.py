"""Bodies near the limits, to every route of a real server: small answers, little time, no memory.

Short here, at length by `make fuzz`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from hypothesis import given
from hypothesis import seed as seeded

from app.services.accounts import accounts
from app.services.arrival import admission
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.web.http.body_limit import SMALL, limit_of
from tests.conftest import SHORT_PLAN, Idle, StudyShelf
from tests.fuzz import heavy
from tests.fuzz.plugin import Fuzz
from tests.fuzz.watched_process import WatchedProcess

from .conftest import EMAIL, PASSWORD
from .house import routes
from .served import Served

# The server begins before a test has a database of its own, and none of this is about databases.
pytestmark = pytest.mark.sqlite

PART = "bodies near the limits"
#: By how much the server may grow in all, in megabytes: one 10 MB body once took 900.
MOST_GROWTH_MB = 150
#: What one request may take of a processor, in seconds, by whether a stranger's may be as long.
MOST_S, MOST_OF_THE_SIGNED_IN_S = 0.5, 2.0
LARGEST_REFUSAL = 10_000


@dataclass(frozen=True)
class At:
    """A server, and what lets one in."""

    server: WatchedProcess
    browser: httpx.Client
    session: str
    csrf: str


@pytest.fixture(scope="module")
def at(
    tmp_path_factory: pytest.TempPathFactory, media_dir: Path, study_shelf: StudyShelf
) -> Iterator[At]:
    tmp_path: Path = tmp_path_factory.mktemp("heavy")
    app = open_app(Settings(data_dir=tmp_path / "data", media_dir=media_dir), background=Idle(1))
    study_shelf.put_into(app, SHORT_PLAN)
    accounts.create(app, EMAIL, PASSWORD)
    sign_in = accounts.sign_in(app, EMAIL, PASSWORD)
    session, _ = admission.start(app, "short")
    app.close()
    with (
        Served("serve", tmp_path / "data", media_dir) as served,
        httpx.Client(base_url=served.url, timeout=60) as browser,
    ):
        browser.cookies.set("pbpo_sign_in", sign_in)
        found = re.search(r'name="csrf_token" value="([0-9a-f]+)"', browser.get("/studies").text)
        assert found
        yield At(WatchedProcess(served.pid), browser, session, found[1])


def test_bodies_near_the_limits_cost_little(at: At, application: FastAPI, fuzz: Fuzz) -> None:
    targets = sorted(
        route.partition(" ")[2] for route in routes(application) if route.startswith("POST ")
    )
    assert len(targets) > 40

    def send(path: str, body: heavy.Body) -> None:
        address = re.sub(r"\{slug\}", "short", path)
        address = re.sub(r"\{\w+\}", "1", address)
        is_call = path.startswith("/api/")
        headers = {"Content-Type": body.content_type}
        if is_call:
            headers["Authorization"] = f"Bearer {at.session}"
        before = at.server.processor_s
        answer = at.browser.post(address, content=body.content, headers=headers)
        took = at.server.processor_s - before
        fuzz.case(PART, path, answer.status_code)
        assert answer.status_code < 500, answer.text[:500]
        if answer.status_code >= 400:
            assert len(answer.content) < LARGEST_REFUSAL
        is_for_strangers = limit_of(address) == SMALL or is_call
        assert took < (MOST_S if is_for_strangers else MOST_OF_THE_SIGNED_IN_S), took

    def try_it(path: str, seed: int) -> None:
        @given(heavy.bodies(path))
        def one(body: heavy.Body) -> None:
            try:
                send(path, body)
            except Exception as fault:
                fault.add_note(f"POST {path} {body}")
                raise

        fuzz.settings(2)(seeded(seed)(one) if fuzz.seconds else one)()

    def one_round(seed: int) -> None:
        for path in targets:
            try_it(path, seed)
            grown = at.server.memory_mb - at_first
            assert grown < MOST_GROWTH_MB, f"{grown:.0f} MB more after POST {path}"

    at.browser.get("/studies")
    at_first = at.server.memory_mb
    fuzz.rounds(PART, one_round)


@pytest.mark.parametrize("kind", sorted(heavy.KINDS))
def test_each_kind_of_heavy_body_is_refused_where_strangers_may_send_it(at: At, kind: str) -> None:
    content_type, fill = heavy.KINDS[kind]
    path = "/api/v1/session/responses" if content_type == heavy.JSON else "/s/short/consent"
    limit = limit_of(path)
    assert limit is not None
    headers = {"Content-Type": content_type}
    before = at.server.processor_s
    address = at.browser.base_url.join(path)
    answer = httpx.post(address, content=fill(limit)[:limit], headers=headers, timeout=60)
    assert at.server.processor_s - before < MOST_S
    assert 400 <= answer.status_code < 500
    assert len(answer.content) < LARGEST_REFUSAL
