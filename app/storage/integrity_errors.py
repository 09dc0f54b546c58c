"""Classifies integrity errors, and removes the row's values from their messages.

Two concurrent requests can both find that a row does not exist yet. A constraint then lets one of
them insert it and refuses the other, which is a conflict rather than a fault of the program.
"""

from __future__ import annotations

from sqlalchemy.engine import ExceptionContext
from sqlalchemy.exc import DataError, IntegrityError

#: Codes of unique and foreign key violations: of PostgreSQL, and of SQLite.
_OF_TWO_AT_ONCE = frozenset(
    {
        *("23505", "23503"),
        *(f"SQLITE_CONSTRAINT_{rule}" for rule in ("UNIQUE", "PRIMARYKEY", "FOREIGNKEY")),
    }
)


def is_conflict(error: Exception) -> bool:
    """Whether the error is a unique or foreign key violation, as of concurrent requests."""
    original = error.orig if isinstance(error, IntegrityError) else None
    codes = (getattr(original, name, None) for name in ("sqlstate", "sqlite_errorname"))
    return any(code in _OF_TWO_AT_ONCE for code in codes)


def redact_parameters(context: ExceptionContext) -> None:
    """Handler of the engine's `handle_error` event: keeps only the primary message.

    PostgreSQL's full message contains the row's values, and errors are logged.
    """
    original, wrapped = context.original_exception, context.sqlalchemy_exception
    rule = getattr(getattr(original, "diag", None), "message_primary", None)
    if rule is not None and isinstance(wrapped, IntegrityError | DataError):
        wrapped.args = (str(wrapped.args[0]).replace(str(original), rule),)
        original.args = (rule,)
