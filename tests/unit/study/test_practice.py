"""Practice comes once, before the first trial and after the videos."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest

from app.study import Continued, OutOfOrder, Plan, Progress, Responded, Stage, advance, position

NOON = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


@pytest.fixture
def plan(build_plan: Callable[..., Plan]) -> Plan:
    return build_plan(practice={"queries": 2}, familiarisation={"videos": 1}, break_s=0)


def test_practice_follows_the_videos_and_leads_to_the_first_query(plan: Plan) -> None:
    progress = advance(plan, Progress(Stage.FAMILIARISATION), Continued(NOON))
    assert progress == Progress(Stage.PRACTICE)
    progress = advance(plan, progress, Responded(0, NOON))
    assert progress == Progress(Stage.PRACTICE, query_index=1)
    assert position(plan, progress) == {"trial": 0, "trials": 2, "query": 2, "queries": 2}
    assert advance(plan, progress, Responded(1, NOON)) == Progress(Stage.QUERY)


def test_practice_cannot_be_passed_over(plan: Plan) -> None:
    with pytest.raises(OutOfOrder, match="practice queries have to be answered"):
        advance(plan, Progress(Stage.PRACTICE), Continued(NOON))


def test_no_other_trial_begins_with_practice(plan: Plan) -> None:
    after = advance(plan, Progress(Stage.QUERY, query_index=2), Responded(2, NOON))
    assert after == Progress(Stage.QUERY, trial_index=1)


def test_no_condition_is_named_as_the_practice_is(
    folder: Path, edit: Callable[[Path, str, str], None], faults: Callable[[Path], list[str]]
) -> None:
    edit(folder / "study.yaml", "name: without skip", "name: practice")
    assert faults(folder) == []
    edit(
        folder / "study.yaml",
        "queries_per_trial: 4",
        "queries_per_trial: 4\npractice: {queries: 1}",
    )
    assert faults(folder) == [
        (
            "study.yaml:16: conditions[1].name: expected another name,"
            " 'practice' is what the practice is called"
        )
    ]
