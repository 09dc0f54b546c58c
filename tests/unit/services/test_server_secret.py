"""Keys of the server's own: the same in every process, another one for each purpose."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from app.services.server_secret import ServerSecret
from app.storage.database import Database
from tests.conftest import STARTED
from tests.databases import Databases

PROCESSES = 6


@pytest.fixture
def url(databases: Databases, tmp_path: Path) -> str:
    """A database that no server has opened yet."""
    return databases.new(tmp_path)


@pytest.fixture
def several(url: str) -> Iterator[list[Database]]:
    """The same database, opened as often as by that many processes."""
    opened = [Database(url) for _ in range(PROCESSES)]
    yield opened
    for database in opened:
        database.close()


def test_processes_that_start_at_once_have_the_same_keys(several: list[Database]) -> None:
    start = threading.Barrier(PROCESSES)

    def key(database: Database) -> bytes:
        secret = ServerSecret(database)
        start.wait()
        secret.ensure(STARTED)
        return secret.key("forms")

    with ThreadPoolExecutor(PROCESSES) as threads:
        keys = set(threads.map(key, several))
    assert len(keys) == 1
    assert len(keys.pop()) == 32


def test_keys_of_different_purposes_and_servers_differ(
    several: list[Database], databases: Databases, tmp_path: Path
) -> None:
    ours = ServerSecret(several[0])
    ours.ensure(STARTED)
    other = Database(databases.new(tmp_path / "other"))
    theirs = ServerSecret(other)
    theirs.ensure(STARTED)
    keys = {secret.key(purpose) for secret in (ours, theirs) for purpose in ("forms", "links")}
    other.close()
    assert len(keys) == 4


def test_a_key_is_the_same_after_a_restart(several: list[Database]) -> None:
    before, after = (ServerSecret(database) for database in several[:2])
    before.ensure(STARTED)
    key = before.key("forms")
    after.ensure(STARTED)
    assert after.key("forms") == key


def test_a_key_is_had_within_a_transaction(several: list[Database]) -> None:
    secret = ServerSecret(several[0])
    secret.ensure(STARTED)
    with several[0].write():
        assert len(secret.key("forms")) == 32
