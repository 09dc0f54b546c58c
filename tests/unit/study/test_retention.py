"""How long a study keeps what it is given: what is due when, and rules that cannot be."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from app.study.retention import Due, Retention, due

Edit = Callable[[Path, str, str], None]
Faults = Callable[[Path], list[str]]

ENDED = datetime(2026, 3, 1, 12, tzinfo=UTC)
EXPIRES = datetime(2026, 3, 15, 12, tzinfo=UTC)
BOTH = Retention(identity_days=10, everything_days=20)


@pytest.mark.parametrize(
    ("days", "expected"),
    [(9.99, Due(False, False)), (10, Due(True, False)), (19.99, Due(True, False))],
)
def test_identities_are_due_before_everything(days: float, expected: Due) -> None:
    assert due(BOTH, ENDED, EXPIRES, ENDED + timedelta(days=days)) == expected


def test_days_count_from_the_end_or_else_from_the_expiry() -> None:
    at = ENDED + timedelta(days=20)
    assert due(BOTH, ENDED, EXPIRES, at) == Due(True, True)
    assert due(BOTH, None, EXPIRES, at) == Due(False, False)
    assert due(BOTH, None, EXPIRES, EXPIRES + timedelta(days=20)) == Due(True, True)


def test_without_a_rule_nothing_is_ever_due() -> None:
    assert due(Retention(), ENDED, EXPIRES, ENDED + timedelta(days=36_500)) == Due(False, False)


def test_identities_go_with_everything_at_the_latest() -> None:
    rule = Retention(everything_days=20)
    assert rule.identities_kept_for == 20
    assert due(rule, ENDED, EXPIRES, ENDED + timedelta(days=20)) == Due(True, True)


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        (
            "{identity_days: 21, everything_days: 20}",
            "expected at most everything_days (20), got 21",
        ),
        ("{identity_days: 0}", "expected a whole number of days from 1 to 36500, got 0"),
        (
            "{everything_days: never}",
            "whole number of days from 1 to 36500, got 'never'",
        ),
        ("{days: 3}", "days"),
    ],
)
def test_a_rule_that_cannot_be_is_named(
    folder: Path, edit: Edit, faults: Faults, rule: str, expected: str
) -> None:
    edit(folder / "study.yaml", "queries_per_trial: 4", f"queries_per_trial: 4\nretention: {rule}")
    found = faults(folder)
    assert len(found) == 1, found
    assert "retention" in found[0]
    assert expected in found[0]
