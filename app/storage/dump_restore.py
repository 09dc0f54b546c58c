"""Dumps a database into one file while it is in use, and restores it into an empty database.

SQLite is copied by its online backup API, PostgreSQL by pg_dump and pg_restore, which must be of
the server's version or newer.

A restored database contains people who were deleted after the dump. Until they have been deleted
again, a marker table keeps the application from opening the database; the marker also remains if
the restore is killed.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, create_engine, inspect, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import SQLAlchemyError

from .schema import revision_of

SQLITE = "sqlite"
POSTGRESQL = "postgresql"

#: Schema of Procrastinate's queue. It is not dumped: waiting tasks are enqueued again.
QUEUE_SCHEMA = "procrastinate"

#: Marker table, present from before the restore until the deletions have been repeated.
_MARK = "restore_not_finished"
_MAKE_MARK = f"CREATE TABLE {_MARK} (since INTEGER)"

#: Selects the trigger functions of our tables, which are not dropped with the tables.
_FUNCTIONS_OF_TRIGGERS = """
    SELECT DISTINCT tgfoid::regprocedure::text
    FROM pg_trigger JOIN pg_class ON pg_class.oid = tgrelid
    WHERE NOT tgisinternal AND relnamespace = current_schema()::regnamespace
"""

_AGAIN = "throw the database away, and restore into a new one"

#: Options that are never passed as command-line arguments, which all users of a machine can see.
_SECRET = ("password", "sslpassword")


class DumpError(Exception):
    """A dump or a restore failed. The message says why, and does not contain the URL."""


@dataclass(frozen=True)
class Contents:
    """Schema revision of a database, and the number of rows by table."""

    revision: str | None
    rows: Mapping[str, int]


def kind_of(url: str) -> str:
    """SQLITE or POSTGRESQL."""
    return make_url(url).get_backend_name()


def dump(url: str, target: Path) -> Contents:
    """Write the database into `target`, and return what the file contains.

    The database may be used meanwhile. Raises DumpError.
    """
    return _dump_sqlite(url, target) if kind_of(url) == SQLITE else _dump_postgresql(url, target)


@contextmanager
def loaded(source: Path, url: str) -> Iterator[Contents]:
    """Restore a dump into an empty database (SQLite: no file), and yield what it contains.

    Until the block ends, `require_whole` refuses the database to everyone else. If the block raises
    an exception, the database is emptied again. Raises DumpError.
    """
    _claim(url)
    try:
        _load(source, url)
        yield contents(url)
        _change(url, [f"DROP TABLE {_MARK}"])
    except BaseException as error:
        try:
            _clear(url)
        except (SQLAlchemyError, OSError):
            raise DumpError(
                f"{error}; and what it put into the database could not be taken out again: {_AGAIN}"
            ) from error
        raise


def require_whole(connection: Connection) -> None:
    """Raise DumpError if a restore into this database is under way or did not finish."""
    if inspect(connection).has_table(_MARK):
        raise DumpError(
            "a restore into this database is under way or did not finish, and people who were"
            f" deleted may be in it. If it is not under way: {_AGAIN}"
        )


def contents(url: str, *, whole: bool = False) -> Contents:
    """The present contents of a database. whole: raise DumpError if a restore did not finish."""
    with _connected(url) as connection:
        if whole:
            require_whole(connection)
        return _contents(connection)


def _dump_sqlite(url: str, target: Path) -> Contents:
    path = _file(url)
    if not path.is_file():
        raise DumpError(f"expected a database at {path}, and there is none")
    with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(target)) as copy:
        source.backup(copy)
        # Without a write-ahead log, so that the dump is a single file.
        copy.execute("PRAGMA journal_mode = DELETE")
        faults = copy.execute("PRAGMA integrity_check").fetchall()
    if faults != [("ok",)]:
        raise DumpError(f"the database is damaged: {faults[0][0]}")
    return contents(f"sqlite:///{target}", whole=True)


def _dump_postgresql(url: str, target: Path) -> Contents:
    with _connected(url, isolation_level="REPEATABLE READ") as connection:
        require_whole(connection)
        # pg_dump sees exactly what is counted here, whatever is written meanwhile.
        snapshot = str(connection.scalar(text("SELECT pg_export_snapshot()")))
        words = (
            *("--format=custom", "--no-owner", "--no-acl", f"--snapshot={snapshot}"),
            f"--exclude-schema={QUEUE_SCHEMA}",
        )
        _run(url, "pg_dump", *words, f"--file={target}")
        return _contents(connection)


def _claim(url: str) -> None:
    """Check that the database is empty, and create the marker table. Raises DumpError."""
    if kind_of(url) == SQLITE:
        # `_load` creates the file with the marker already in it.
        if _file(url).exists():
            raise DumpError(f"expected a new database at {_file(url)}, and there is a file")
        return
    with _connected(url) as connection:
        require_whole(connection)
        if inspect(connection).get_table_names():
            raise DumpError("expected an empty database at PBPO_DATABASE_URL, and it has tables")
        connection.execute(text(_MAKE_MARK))
        connection.commit()


def _load(source: Path, url: str) -> None:
    if kind_of(url) == POSTGRESQL:
        words = ("--no-owner", "--no-acl", "--single-transaction")
        _run(url, "pg_restore", *words, str(source))
        return
    path = _file(url)
    part = path.with_name(f"{path.name}.part")
    shutil.copyfile(source, part)
    _change(f"sqlite:///{part}", [_MAKE_MARK])
    part.rename(path)


def _clear(url: str) -> None:
    """Delete everything that was restored, in one transaction."""
    if kind_of(url) == SQLITE:
        path = _file(url)
        for ending in ("", ".part", "-wal", "-shm", "-journal"):
            path.with_name(f"{path.name}{ending}").unlink(missing_ok=True)
        return
    with _connected(url) as connection:
        functions = connection.scalars(text(_FUNCTIONS_OF_TRIGGERS)).all()
        quoted = connection.dialect.identifier_preparer.quote
        tables = [quoted(name) for name in inspect(connection).get_table_names()]
    if tables:
        dropped = [f"DROP FUNCTION {function}" for function in functions]
        _change(url, [f"DROP TABLE {', '.join(tables)} CASCADE", *dropped])


def _change(url: str, statements: Sequence[str]) -> None:
    """Execute the statements in one transaction."""
    with _connected(url) as connection:
        for statement in statements:
            connection.execute(text(statement))
        connection.commit()


@contextmanager
def _connected(url: str, **options: Any) -> Iterator[Connection]:
    engine = create_engine(url, hide_parameters=True, **options)
    try:
        with engine.connect() as connection:
            yield connection
    finally:
        engine.dispose()


def _contents(connection: Connection) -> Contents:
    names = sorted(set(inspect(connection).get_table_names()) - {_MARK})
    quoted = connection.dialect.identifier_preparer.quote
    rows = {
        name: int(connection.scalar(text(f"SELECT count(*) FROM {quoted(name)}")) or 0)  # noqa: S608
        for name in names
    }
    return Contents(revision_of(connection), rows)


def _file(url: str) -> Path:
    return Path(make_url(url).database or "")


def _run(url: str, program: str, *words: str) -> None:
    """Run pg_dump or pg_restore on the database. Raises DumpError."""
    if shutil.which(program) is None:
        raise DumpError(
            f"expected {program} on this machine, of the database's version or newer, and there is"
            " none (Debian: apt-get install postgresql-client)"
        )
    place, password = reached(url)
    environment = os.environ if password is None else {**os.environ, "PGPASSWORD": password}
    done = subprocess.run(  # noqa: S603 - the program's name is one of ours
        [program, f"--dbname={place}", *words],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        said = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise DumpError("; ".join([f"{program} failed", *said[:2]]))


def reached(url: str) -> tuple[str, str | None]:
    """A libpq connection string for the URL, without secrets, and the password."""
    # psycopg is an optional dependency.
    from psycopg.conninfo import make_conninfo  # noqa: PLC0415

    parts = make_url(url)
    _, options = parts.get_dialect()().create_connect_args(parts)
    said = {name: value for name, value in options.items() if name not in _SECRET}
    return make_conninfo(**said), options.get("password")
