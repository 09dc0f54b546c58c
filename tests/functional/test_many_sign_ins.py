"""Sign-ins that come at once, or without end: what they cost, and what is kept of them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager

import pytest
from sqlalchemy import event

from app.services.accounts import accounts, audit_log, login_rate_limit, password_hash_limit
from app.services.context import AppContext
from app.services.runtime.errors import (
    SignInRequiredError,
    TooManyPasswordsError,
    TooManyTriesError,
)
from app.storage.models.accounts import FailedSignIn
from app.storage.models.records import AuditEvent
from tests.conftest import Clock

from .client import Api
from .conftest import EMAIL, PASSWORD
from .test_accounts import NEW_PASSWORD, send
from .test_crowding import rows
from .test_experimenter_pages import sign_in

STRANGERS = "nobody@home.example"


@contextmanager
def another_ones_turn() -> Iterator[None]:
    """Within this, somebody's password is being looked at."""
    with password_hash_limit._queue:
        yield


def test_made_up_addresses_leave_nothing_for_good(
    client: Api, app: AppContext, api_token: str, clock: Clock
) -> None:
    before = rows(app, AuditEvent)
    for number in range(3):
        assert sign_in(client, f"{number}@home.example", "guess").status_code == 401
    assert rows(app, AuditEvent) == before
    clock.forward(15 * 60)
    assert sign_in(client).status_code == 303
    assert rows(app, FailedSignIn) == 0


def test_a_wrong_password_is_in_the_trail_where_there_is_an_account(
    client: Api, app: AppContext, api_token: str
) -> None:
    assert sign_in(client, EMAIL, "guess").status_code == 401
    newest = audit_log.trail(app)[0]
    assert (newest.action, newest.details) == ("sign-in failed", {"account": EMAIL})


def test_an_address_is_written_for_as_often_whether_somebody_has_it_or_not(
    app: AppContext, api_token: str
) -> None:
    written: list[str] = []

    def look(_connection: object, _cursor: object, statement: str, *_: object) -> None:
        if statement.startswith(("INSERT", "UPDATE")):
            written.append(statement)

    event.listen(app.database.engine, "before_cursor_execute", look)
    writers = []
    for email in (EMAIL, STRANGERS):
        written.clear()
        with pytest.raises(SignInRequiredError):
            accounts.sign_in(app, email, "guess")
        # All but what is added to the trail, in the last of the transactions.
        writers.append([one for one in written if "audit_events" not in one])
    assert writers[0] == writers[1]
    assert len(writers[0]) == 2


def test_whoever_gets_no_turn_is_told_to_come_back_and_nothing_was_tried(
    client: Api, app: AppContext, api_token: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(password_hash_limit, "WAIT_TIMEOUT_S", 0.01)
    with another_ones_turn():
        refusal = sign_in(client)
    assert (refusal.status_code, refusal.headers["retry-after"]) == (429, "10")
    assert "Too many are signing in just now" in refusal.text
    assert rows(app, FailedSignIn) == 0
    assert sign_in(client).status_code == 303

    given = {"old": PASSWORD, "new": NEW_PASSWORD, "again": NEW_PASSWORD}
    with another_ones_turn():
        refusal = send(client, "/account/password", "/account", **given)
    assert (refusal.status_code, refusal.headers["retry-after"]) == (429, "10")
    assert send(client, "/account/password", "/account", **given).status_code == 303


def test_only_a_few_wait_for_their_turn(app: AppContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(password_hash_limit, "_slots", threading.BoundedSemaphore(2))
    # Whoever waits does so for longer than this test.
    monkeypatch.setattr(password_hash_limit, "WAIT_TIMEOUT_S", 600)

    def one_more() -> None:
        with password_hash_limit.hash_slot(app):
            pass

    with ThreadPoolExecutor() as threads:
        with another_ones_turn():
            several = [threads.submit(one_more) for _ in range(3)]
            done, waiting = wait(several, timeout=20, return_when="FIRST_COMPLETED")
            assert [type(one.exception()) for one in done] == [TooManyPasswordsError]
            assert not any(one.done() for one in waiting)
        assert [one.result(20) for one in waiting] == [None, None]


def test_of_two_tries_at_once_the_second_sees_the_first(app: AppContext) -> None:
    now = app.now()
    with app.database.write() as db:
        for _ in range(login_rate_limit.TRIES - 1):
            login_rate_limit.record_attempt(db, now, EMAIL)

    def the_eleventh() -> None:
        with app.database.write() as db:
            login_rate_limit.record_attempt(db, now, EMAIL)

    with ThreadPoolExecutor(1) as thread:
        with app.database.write() as db:
            login_rate_limit.record_attempt(db, now, EMAIL)
            db.flush()
            another = thread.submit(the_eleventh)
            # It has to wait; one that does not has counted nine, and is let through.
            wait([another], timeout=0.3)
        with pytest.raises(TooManyTriesError):
            another.result(20)
    assert rows(app, FailedSignIn) == login_rate_limit.TRIES


@pytest.mark.postgresql
def test_those_who_try_another_address_do_not_wait(app: AppContext) -> None:
    now = app.now()

    def another_address() -> None:
        with app.database.write() as db:
            login_rate_limit.record_attempt(db, now, STRANGERS)

    with ThreadPoolExecutor(1) as thread, app.database.write() as db:
        login_rate_limit.record_attempt(db, now, EMAIL)
        db.flush()
        thread.submit(another_address).result(20)
