"""The end of a transaction that writes, and the one moment in which nobody knows what was done."""

from __future__ import annotations

from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

#: What PostgreSQL says to whom it hangs up on: whether it did what it was about is not said.
_HANGS_UP = "57P"


class CommitLostError(OperationalError):
    """The server was lost while it committed: what was to be written is all there or not at all."""


def commit(db: Session) -> None:
    """Commit what was flushed. Raises CommitLostError, or OperationalError if nothing was done."""
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
