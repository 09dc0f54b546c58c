"""Who does not wait for PostgreSQL is told so soon, whatever holds it up, and nothing was done."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager

import psutil
import pytest
from sqlalchemy import func, select, text
from sqlalchemy.orm import Session

from app.services.studio import Studio
from app.storage import impatient, patience
from app.storage.accounts import Account
from app.storage.commits import CommitLostError
from app.storage.database import Database

from .test_reading import add_account

pytestmark = pytest.mark.postgresql

#: Long enough on a busy machine; who waits would wait for ever.
SOON_S = 10.0
#: When a commit is given up: later than a statement.
LOST_S = 3.0
#: For how long a server is let be: longer than to look at it in between.
REST_S = 1.5


@pytest.fixture
def database(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> Iterator[Database]:
    """A door of its own to the studio's database, which somebody who waits has gone through."""
    monkeypatch.setattr(impatient, "COMMIT_S", LOST_S)
    monkeypatch.setattr(impatient, "REST_S", REST_S)
    add_account(studio, "first")
    made = Database(studio.settings.url)
    assert not made.answers_at_once
    assert count(made) == 1
    assert made.answers_at_once
    yield made
    made.close()


def count(database: Database) -> int:
    with database.read() as session:
        return session.scalar(select(func.count(Account.id))) or 0


def write(database: Database) -> None:
    with database.write() as session:
        session.scalars(select(Account).with_for_update()).one().email = "second@lab.example"


def pid_of(database: Database) -> int:
    """What answers who does not wait, at the server."""
    with patience.at_once(), database.read() as session:
        pid: int = answers(session).pid
        return pid


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

    before = pid_of(database)
    with soon(), pytest.raises(patience.NeedsPatienceError), patience.at_once():
        sleep()
    assert not database.answers_at_once
    # The server has said so itself: it is the same connection.
    assert pid_of(database) == before


def test_a_server_that_says_nothing_is_left_to_those_who_wait_and_asked_again_later(
    database: Database,
) -> None:
    with silent(psutil.Process(pid_of(database))), soon():
        with pytest.raises(patience.NeedsPatienceError), patience.at_once():
            count(database)
        assert not database.answers_at_once
        # Somebody who could wait was answered, but only just now.
        assert count(database) == 1
        assert not database.answers_at_once
    time.sleep(impatient.REST_S)
    assert count(database) == 1
    assert database.answers_at_once
    with patience.at_once():
        assert count(database) == 1


def test_silence_at_the_end_of_a_look_is_silence_too(database: Database) -> None:
    silence = ExitStack()

    def look() -> None:
        with database.read() as session:
            session.scalar(select(func.count(Account.id)))
            silence.enter_context(silent(answers(session)))

    with silence, soon():
        with pytest.raises(patience.NeedsPatienceError), patience.at_once():
            look()
        assert not database.answers_at_once


def test_a_connection_that_was_cut_is_replaced(studio: Studio, database: Database) -> None:
    with studio.database.read() as session:
        session.execute(select(func.pg_terminate_backend(pid_of(database), 5_000)))
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

    with silence, soon(), pytest.raises(CommitLostError), patience.at_once():
        lose()
    # What the server was told to commit, it commits as soon as it goes on.
    with soon():
        while emails(database) != ["second@lab.example"]:
            time.sleep(0.02)


def test_a_commit_that_takes_long_is_waited_for(database: Database) -> None:
    with patience.at_once(), ThreadPoolExecutor(1) as later:
        with database.write() as session:
            session.scalars(select(Account)).one().email = "second@lab.example"
            session.flush()
            answering = answers(session)
            answering.suspend()
            later.submit(time.sleep, 1.3 * impatient.SILENCE_S)
            later.submit(answering.resume)
        assert emails(database) == ["second@lab.example"]


def test_a_server_that_is_far_away_is_left_to_those_who_wait(
    studio: Studio, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(impatient, "NEAR_S", 0.0)
    made = Database(studio.settings.url)
    assert count(made) == 0
    assert not made.answers_at_once
    made.close()
