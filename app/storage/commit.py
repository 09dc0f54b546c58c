"""Commit of a writing transaction, which tells a lost commit from a failed one.

If the connection drops during COMMIT, the client cannot know whether the server committed.
"""

from __future__ import annotations

from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

#: Class of PostgreSQL's error codes for a connection that the server ends (operator intervention).
_HANGS_UP = "57P"


class CommitLostError(OperationalError):
    """The connection dropped during COMMIT: everything was written, or nothing was."""


def commit(db: Session) -> None:
    """Commit. Raises CommitLostError if the outcome is unknown, OperationalError if it failed."""
    try:
        db.commit()
    except OperationalError as error:
        if db.get_bind().dialect.name == "sqlite":
            raise
        code = getattr(error.orig, "sqlstate", None)
        if code is not None and not code.startswith(_HANGS_UP):
            raise
        db.invalidate()
        raise CommitLostError(error.statement, None, error.orig or error) from error
