"""Who does not wait for PostgreSQL is told so soon, whatever holds it up, and nothing was done."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import psutil
import pytest
from sqlalchemy import func, select, text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from app.services.studio import Studio
from app.storage import impatient, patience
from app.storage.accounts import Account
from app.storage.database import Database

from .test_reading import add_account

pytestmark = pytest.mark.postgresql

#: Long enough on a busy machine; who waits would wait for ever.
SOON_S = 10.0


@pytest.fixture
def database(studio: Studio) -> Iterator[Database]:
    """A door to the studio's database that nobody has gone through yet."""
    add_account(studio, "first")
    made = Database(studio.settings.url)
    yield made
    made.close()


def count(database: Database) -> int:
    with database.read() as session:
        return session.scalar(select(func.count(Account.id))) or 0


def write(database: Database) -> None:
    with database.write() as session:
        session.scalars(select(Account).with_for_update()).one().email = "second@lab.example"


def emails(database: Database) -> list[str]:
    with database.read() as session:
        return list(session.scalars(select(Account.email)))


@contextmanager
def soon() -> Iterator[None]:
    begun = time.monotonic()
    yield
    assert time.monotonic() - begun < SOON_S


def answers(session: Session) -> psutil.Process:
    """What answers this session, at the server."""
    return psutil.Process(session.scalar(select(func.pg_backend_pid())))


@contextmanager
def silent(answering: psutil.Process) -> Iterator[None]:
    """It says nothing."""
    answering.suspend()
    try:
        yield
    finally:
        answering.resume()


def test_a_row_that_another_holds_is_said_to_be_held(studio: Studio, database: Database) -> None:
    with studio.database.write() as session:
        session.scalars(select(Account).with_for_update()).one()
        with soon(), pytest.raises(patience.BusyError), patience.at_once():
            write(database)
        with patience.at_once():
            assert count(database) == 1
    assert database.answers_at_once
    with patience.at_once():
        write(database)
    assert emails(database) == ["second@lab.example"]


def test_a_statement_that_takes_long_is_given_up(database: Database) -> None:
    def sleep() -> None:
        with database.read() as session:
            session.execute(text("SELECT pg_sleep(60)"))

    with soon(), pytest.raises(patience.NeedsPatienceError), patience.at_once():
        sleep()
    with patience.at_once():
        assert count(database) == 1


def test_a_server_that_says_nothing_is_left_to_those_who_wait(database: Database) -> None:
    with patience.at_once(), database.read() as session:
        answering = answers(session)
    with silent(answering), soon():
        with pytest.raises(patience.NeedsPatienceError), patience.at_once():
            count(database)
        assert not database.answers_at_once
        # Somebody who could wait was answered.
        assert count(database) == 1
        assert database.answers_at_once
        with patience.at_once():
            assert count(database) == 1


def test_a_connection_that_was_cut_is_replaced(studio: Studio, database: Database) -> None:
    with patience.at_once(), database.read() as session:
        answering = answers(session)
    with studio.database.read() as session:
        session.execute(select(func.pg_terminate_backend(answering.pid, 5_000)))
    with soon(), pytest.raises(patience.NeedsPatienceError), patience.at_once():
        write(database)
    with patience.at_once():
        write(database)
    assert emails(database) == ["second@lab.example"]


def test_of_a_commit_that_was_lost_nobody_says_that_nothing_was_done(
    database: Database,
) -> None:
    silence = ExitStack()

    def lose() -> None:
        with database.write() as session:
            session.scalars(select(Account)).one().email = "second@lab.example"
            session.flush()
            silence.enter_context(silent(answers(session)))

    with silence, soon(), pytest.raises(OperationalError), patience.at_once():
        lose()


def test_a_server_that_is_far_away_is_left_to_those_who_wait(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(impatient, "NEAR_S", 0.0)
    assert database.answers_at_once
    with patience.at_once():
        assert count(database) == 1
    assert not database.answers_at_once
    assert count(database) == 1
    assert not database.answers_at_once
