"""How one value is written in a cell of an export."""

from __future__ import annotations

import csv
import io
from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.services.export.cells import Value, cell


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (None, ""),
        (True, "true"),
        (False, "false"),
        (7, "7"),
        (-3.5, "-3.5"),
        (0.1 + 0.2, "0.30000000000000004"),
        ("left", "left"),
        ("", ""),
        (datetime(2026, 3, 1, 9, tzinfo=UTC), "2026-03-01T09:00:00.000Z"),
        (datetime(2026, 3, 1, 9, 0, 0, 1500, tzinfo=UTC), "2026-03-01T09:00:00.001Z"),
    ],
)
def test_a_value_is_written_as_people_and_programs_read_it(value: Value, written: str) -> None:
    assert cell(value) == written


def test_a_time_of_another_zone_is_written_in_utc() -> None:
    tokyo = timezone(timedelta(hours=9))
    assert cell(datetime(2026, 3, 1, 9, tzinfo=tokyo)) == "2026-03-01T00:00:00.000Z"


@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t", "\r", "\n"])
def test_a_text_that_a_spreadsheet_would_run_gets_an_apostrophe(start: str) -> None:
    assert cell(f"{start}1+1") == f"'{start}1+1"
    assert cell(f"a{start}1") == f"a{start}1"


@settings(deadline=None)
@given(st.text())
def test_no_text_starts_a_formula_and_none_loses_a_letter(text: str) -> None:
    written = cell(text)
    assert written.removeprefix("'") == text.removeprefix("'")
    assert not written.startswith(("=", "+", "-", "@", "\t", "\r", "\n"))


@settings(deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_read_back_as_the_very_same(number: float) -> None:
    line = io.StringIO()
    csv.writer(line).writerow([cell(number)])
    assert float(next(csv.reader([line.getvalue()]))[0]) == number
