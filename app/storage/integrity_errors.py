"""What the database says where it refuses a row: which rule, and never what stands in the row.

Of two who do the same at once both have looked, and seen that nobody did it yet. The tables' rules
then let one of them in, and refuse the other.
"""

from __future__ import annotations

from sqlalchemy.engine import ExceptionContext
from sqlalchemy.exc import DataError, IntegrityError

#: Something is there already, or what it belongs to is gone: as PostgreSQL calls it, and SQLite.
_OF_TWO_AT_ONCE = frozenset(
    {
        *("23505", "23503"),
        *(f"SQLITE_CONSTRAINT_{rule}" for rule in ("UNIQUE", "PRIMARYKEY", "FOREIGNKEY")),
    }
)


def is_conflict(error: Exception) -> bool:
    """Whether it is the refusal of somebody who came second. Any other refusal is a fault."""
    refused = error.orig if isinstance(error, IntegrityError) else None
    codes = (getattr(refused, name, None) for name in ("sqlstate", "sqlite_errorname"))
    return any(code in _OF_TWO_AT_ONCE for code in codes)


def redact_parameters(context: ExceptionContext) -> None:
    """For the engine's `handle_error`: PostgreSQL repeats the row, and errors end in logs."""
    refused, told = context.original_exception, context.sqlalchemy_exception
    rule = getattr(getattr(refused, "diag", None), "message_primary", None)
    if rule is not None and isinstance(told, IntegrityError | DataError):
        told.args = (str(told.args[0]).replace(str(refused), rule),)
        refused.args = (rule,)
