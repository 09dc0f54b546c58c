"""Times go in and come out in UTC."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import pytest
from sqlalchemy.dialects import sqlite

from app.storage.models.types import UtcDateTime

#: Nothing here asks a database.
pytestmark = pytest.mark.sqlite

DIALECT = sqlite.dialect()
COLUMN = UtcDateTime()


def test_a_time_without_a_zone_is_refused() -> None:
    with pytest.raises(ValueError, match="expected a datetime with a time zone, got 2026-03-01"):
        COLUMN.process_bind_param(datetime(2026, 3, 1), DIALECT)  # noqa: DTZ001 - that is the test


def test_a_time_of_another_zone_is_stored_as_the_same_moment_in_utc() -> None:
    tokyo = timezone(timedelta(hours=9))
    stored = COLUMN.process_bind_param(datetime(2026, 3, 1, 9, tzinfo=tokyo), DIALECT)
    assert stored == datetime(2026, 3, 1, 0, tzinfo=UTC)
    assert stored.tzinfo is UTC


def test_a_time_that_the_database_has_forgotten_the_zone_of_is_read_as_utc() -> None:
    naive = datetime(2026, 3, 1, 9)  # noqa: DTZ001 - as SQLite gives it back
    assert COLUMN.process_result_value(naive, DIALECT) == datetime(2026, 3, 1, 9, tzinfo=UTC)
    tokyo = timezone(timedelta(hours=9))
    aware = datetime(2026, 3, 1, 9, tzinfo=tokyo)
    assert COLUMN.process_result_value(aware, DIALECT) == aware


def test_no_time_stays_no_time() -> None:
    assert COLUMN.process_bind_param(None, DIALECT) is None
    assert COLUMN.process_result_value(None, DIALECT) is None
