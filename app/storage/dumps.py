"""A database as one file, taken while it is in use, and put back into an empty one.

SQLite copies itself by its online backup; PostgreSQL has pg_dump and pg_restore for it, which have
to be of the server's version or a newer one. What is counted is what the file holds.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import Connection, create_engine, inspect, text
from sqlalchemy.engine import URL, make_url

from .schema import revision_of

SQLITE = "sqlite"
POSTGRESQL = "postgresql"

#: Where Procrastinate keeps its queue: what waits there is asked for again.
QUEUE_SCHEMA = "procrastinate"


class DumpError(Exception):
    """A database could not be copied, or be put back; the message says why, without its address."""


@dataclass(frozen=True)
class Contents:
    """What a database holds: its schema's revision, and the number of rows of each table."""

    revision: str | None
    rows: Mapping[str, int]


def kind_of(url: str) -> str:
    return make_url(url).get_backend_name()


def dump(url: str, target: Path) -> Contents:
    """Write the database into `target`; others may read and write it meanwhile."""
    return _dump_sqlite(url, target) if kind_of(url) == SQLITE else _dump_postgresql(url, target)


def load(source: Path, url: str) -> None:
    """Put a dump back. The database must be empty; SQLite's file must not be there."""
    if kind_of(url) == SQLITE:
        shutil.copyfile(source, _file(url))
        return
    if contents(url).rows:
        raise DumpError("expected an empty database at PBPO_DATABASE_URL, and it has tables")
    _run(url, "pg_restore", "--no-owner", "--no-acl", "--exit-on-error", str(source))


def contents(url: str) -> Contents:
    """What the database holds now."""
    engine = create_engine(url, hide_parameters=True)
    try:
        with engine.connect() as connection:
            return _contents(connection)
    finally:
        engine.dispose()


def _dump_sqlite(url: str, target: Path) -> Contents:
    path = _file(url)
    if not path.is_file():
        raise DumpError(f"expected a database at {path}, and there is none")
    with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(target)) as copy:
        source.backup(copy)
        # In one file alone: with a write-ahead log beside it, half of it could be left behind.
        copy.execute("PRAGMA journal_mode = DELETE")
        faults = copy.execute("PRAGMA integrity_check").fetchall()
    if faults != [("ok",)]:
        raise DumpError(f"the database is damaged: {faults[0][0]}")
    return contents(f"sqlite:///{target}")


def _dump_postgresql(url: str, target: Path) -> Contents:
    engine = create_engine(url, isolation_level="REPEATABLE READ", hide_parameters=True)
    try:
        with engine.connect() as connection:
            # pg_dump sees exactly what is counted here, whatever is written meanwhile.
            snapshot = str(connection.scalar(text("SELECT pg_export_snapshot()")))
            words = (
                *("--format=custom", "--no-owner", "--no-acl", f"--snapshot={snapshot}"),
                f"--exclude-schema={QUEUE_SCHEMA}",
            )
            _run(url, "pg_dump", *words, f"--file={target}")
            return _contents(connection)
    finally:
        engine.dispose()


def _contents(connection: Connection) -> Contents:
    names = sorted(inspect(connection).get_table_names())
    quoted = connection.dialect.identifier_preparer.quote
    rows = {
        name: int(connection.scalar(text(f"SELECT count(*) FROM {quoted(name)}")) or 0)  # noqa: S608
        for name in names
    }
    return Contents(revision_of(connection), rows)


def _file(url: str) -> Path:
    return Path(make_url(url).database or "")


def _run(url: str, program: str, *words: str) -> None:
    """Run one of PostgreSQL's programs on the database. Raises DumpError."""
    if shutil.which(program) is None:
        raise DumpError(
            f"expected {program} on this machine, of the database's version or newer, and there is"
            " none (Debian: apt-get install postgresql-client)"
        )
    parts = make_url(url)
    named = [] if program == "pg_dump" else [f"--dbname={parts.database}"]
    # By its environment: words of a command, and so a password, can be seen by all of the machine.
    environment = {**os.environ, **dict(_environment(parts))}
    done = subprocess.run(  # noqa: S603 - the program's name is one of ours
        [program, *named, *words],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        said = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise DumpError("; ".join([f"{program} failed", *said[:2]]))


def _environment(url: URL) -> Iterator[tuple[str, str]]:
    """What libpq reads of a URL: a socket's folder stands in its query."""
    values = {
        "PGHOST": url.host or url.query.get("host"),
        "PGPORT": url.port or url.query.get("port"),
        "PGUSER": url.username,
        "PGPASSWORD": url.password,
        "PGDATABASE": url.database,
        "PGSSLMODE": url.query.get("sslmode"),
    }
    yield from ((name, str(value)) for name, value in values.items() if value)
