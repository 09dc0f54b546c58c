"""Who may try a password while strangers try many: known browsers at once, others in turn."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from app.services.accounts import accounts, login_rate_limit, password_hash_limit
from app.services.accounts.login_rate_limit import CameFrom
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.errors import (
    SignInRequiredError,
    TooManyPasswordsError,
    TooManyTriesError,
)
from app.services.runtime.settings import Settings
from app.web.experimenter.known_devices import network_of
from tests.conftest import Clock, Idle

from .client import Api
from .conftest import EMAIL, PASSWORD
from .served import Served
from .test_experimenter_pages import sign_in
from .test_many_sign_ins import another_ones_turn

BOB = "bob@lab.example"
HOSTILE = 14
HOME, ELSEWHERE = CameFrom("192.0.2.0/24"), CameFrom("198.51.100.0/24")


def device_cookies(client: Api) -> dict[str, str]:
    return {name: value for name, value in client.cookies.items() if "device" in name}


def guess_from(app: AppContext, came_from: CameFrom, number: int) -> int:
    """How many of so many wrong passwords were looked at."""
    looked_at = 0
    for _ in range(number):
        try:
            accounts.sign_in(app, EMAIL, "a wrong guess", came_from)
        except SignInRequiredError:
            looked_at += 1
        except TooManyTriesError:
            pass
    return looked_at


def test_strangers_who_guess_do_not_keep_a_known_browser_out(
    client: Api, app: AppContext, api_token: str
) -> None:
    assert sign_in(client).status_code == 303
    known = device_cookies(client)
    assert len(known) == 1
    # It tells nobody whose account it is.
    assert EMAIL.partition("@")[0] not in str(known)

    client.cookies.clear()
    for _ in range(login_rate_limit.TRIES):
        assert sign_in(client, EMAIL, "guess").status_code == 401
    assert sign_in(client).status_code == 429
    for name, value in known.items():
        client.cookies.set(name, value)
    assert sign_in(client).status_code == 303


def test_a_cookie_made_up_or_of_another_account_is_not_known(
    client: Api, app: AppContext, api_token: str
) -> None:
    accounts.create(app, BOB, PASSWORD)
    assert sign_in(client, BOB).status_code == 303
    of_bob = device_cookies(client)
    client.cookies.clear()
    assert sign_in(client).status_code == 303
    (name, value), *_ = device_cookies(client).items()
    client.cookies.clear()
    for _ in range(login_rate_limit.TRIES):
        sign_in(client, EMAIL, "guess")
    device, _, signature = value.rpartition(".")
    (bobs,) = of_bob.values()
    for forged in (f"other.{signature}", f"{device}.{'0' * len(signature)}", device, "", bobs):
        client.cookies.set(name, forged)
        assert sign_in(client).status_code == 429, forged


def test_a_known_browser_has_tries_of_its_own_and_no_more(
    client: Api, app: AppContext, api_token: str
) -> None:
    assert sign_in(client).status_code == 303
    for _ in range(login_rate_limit.TRIES):
        assert sign_in(client, EMAIL, "guess").status_code == 401
    assert sign_in(client).status_code == 429
    # Whoever sits there keeps nobody else waiting.
    client.cookies.clear()
    assert sign_in(client).status_code == 303


def test_guesses_from_one_network_do_not_keep_another_out(app: AppContext, api_token: str) -> None:
    assert guess_from(app, HOME, login_rate_limit.TRIES + 5) == login_rate_limit.TRIES
    assert accounts.sign_in(app, EMAIL, PASSWORD, ELSEWHERE)
    with pytest.raises(TooManyTriesError):
        accounts.sign_in(app, EMAIL, PASSWORD, HOME)


def test_guesses_from_many_networks_wait_together(
    app: AppContext, api_token: str, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(accounts, "is_password_of", lambda _account, given: given == PASSWORD)
    looked_at = sum(guess_from(app, CameFrom(f"net {number}"), 10) for number in range(20))
    assert looked_at == login_rate_limit.TRIES_FROM_EVERYWHERE
    with pytest.raises(TooManyTriesError) as refused:
        accounts.sign_in(app, EMAIL, PASSWORD, HOME)
    assert (refused.value.until - app.now()).total_seconds() == 5
    assert accounts.sign_in(app, EMAIL, PASSWORD, CameFrom("net 1", device="known"))
    for wait in (5, 10, 20, 40, 60, 60):
        clock.forward(wait)
        assert guess_from(app, ELSEWHERE, 3) == 1
    clock.forward(60)
    assert accounts.sign_in(app, EMAIL, PASSWORD, HOME)


@pytest.mark.parametrize(
    ("host", "network"),
    [
        ("192.0.2.77", "192.0.2.0/24"),
        ("::ffff:192.0.2.77", "192.0.2.0/24"),
        ("2001:db8:1:2::3", "2001:db8:1::/48"),
        ("testserver", "testserver"),
        ("", ""),
    ],
)
def test_an_address_counts_with_its_network(host: str, network: str) -> None:
    assert network_of(host) == network


def test_known_browsers_go_first_and_networks_by_turns(app: AppContext) -> None:
    order: list[str] = []
    begun = threading.Semaphore(0)

    def one(name: str, came_from: CameFrom) -> None:
        begun.release()
        with password_hash_limit.hash_slot(app, came_from):
            order.append(name)

    waiting = [("flood 1", HOME), ("flood 2", HOME), ("flood 3", HOME), ("other", ELSEWHERE)]
    with ThreadPoolExecutor(10) as threads, another_ones_turn():
        for name, came_from in [*waiting, ("known", CameFrom("x", device="d"))]:
            threads.submit(one, name, came_from)
            begun.acquire()
            # In this order they stand there.
            time.sleep(0.1)
    assert order == ["known", "flood 1", "other", "flood 2", "flood 3"]


def test_one_network_does_not_take_all_places(
    app: AppContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(password_hash_limit, "MAX_WAITING_PER_NETWORK", 2)
    monkeypatch.setattr(password_hash_limit, "MAX_WAITING_KNOWN", 1)

    def one(came_from: CameFrom) -> str:
        try:
            with password_hash_limit.hash_slot(app, came_from):
                return "in"
        except TooManyPasswordsError:
            return "told to come back"

    with ThreadPoolExecutor(10) as threads:
        with another_ones_turn():
            flood = [threads.submit(one, HOME) for _ in range(4)]
            time.sleep(0.3)
            others = [threads.submit(one, ELSEWHERE), threads.submit(one, CameFrom("", "known"))]
            time.sleep(0.3)
        assert sorted(one.result(20) for one in flood) == ["in"] * 2 + ["told to come back"] * 2
        assert [one.result(20) for one in others] == ["in", "in"]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, media_dir: Path) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("flooded")
    app = open_app(Settings(data_dir=folder / "data", media_dir=media_dir), background=Idle(1))
    accounts.create(app, EMAIL, PASSWORD)
    app.close()
    with Served("serve", folder / "data", media_dir) as server:
        yield server.url


def seconds_to_sign_in(browser: httpx.Client, email: str, password: str) -> tuple[int, float]:
    page = browser.get("/sign-in").text
    token = re.search(r'name="csrf_token" value="([0-9a-f]+)"', page)
    assert token is not None
    given = {"email": email, "password": password, "csrf_token": token[1]}
    begun = time.monotonic()
    return browser.post("/sign-in", data=given).status_code, time.monotonic() - begun


# The server begins before a test has a database of its own.
@pytest.mark.sqlite
def test_a_flood_of_sign_ins_does_not_keep_the_right_password_out(served: str) -> None:
    over = threading.Event()
    statuses: list[int] = []

    def flood(number: int) -> None:
        with httpx.Client(base_url=served, timeout=60) as stranger:
            tried = 0
            while not over.is_set():
                tried += 1
                email = f"{number}-{tried}@home.example"
                statuses.append(seconds_to_sign_in(stranger, email, "a wrong guess")[0])

    with httpx.Client(base_url=served, timeout=60) as known:
        assert seconds_to_sign_in(known, EMAIL, PASSWORD)[0] == 303
        with ThreadPoolExecutor(HOSTILE) as threads:
            strangers = [threads.submit(flood, number) for number in range(HOSTILE)]
            try:
                while len(statuses) < HOSTILE:
                    time.sleep(0.1)
                known_took = [seconds_to_sign_in(known, EMAIL, PASSWORD) for _ in range(2)]
                new_took = []
                for _ in range(2):
                    with httpx.Client(base_url=served, timeout=60) as new:
                        new_took.append(seconds_to_sign_in(new, EMAIL, PASSWORD))
            finally:
                over.set()
        assert [one.exception() for one in strangers] == [None] * HOSTILE
    assert {status for status, _ in known_took + new_took} == {303}
    # One password may be looked at just then; the machine has the flood to serve as well.
    slowest_known, slowest_new = (max(took for _, took in all_) for all_ in (known_took, new_took))
    assert slowest_known < 5
    assert slowest_known < slowest_new
    # As many as there are hostile ones go first, at the most.
    assert slowest_new < password_hash_limit.WAIT_TIMEOUT_S
