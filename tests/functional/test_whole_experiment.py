"""The published experiment with people, from the consent to the end, over HTTP.

Everything is as shipped but for how long it is: two pairs to a trial, and four videos to watch.
"""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

import pytest

from app.services.context import AppContext
from app.services.studies import repository
from app.storage.models.studies import SessionRow
from app.study.assignment import plan_orders, trial_conditions
from app.study.folder import resolve
from app.study.plan import Plan
from tests.conftest import Clock

from .client import Api, Session

SLUG = "waste-crane-paper"
QUERIES = 2
VIDEOS = 4


@pytest.fixture
def plan(app: AppContext, tmp_path: Path) -> Plan:
    """The shipped plan, opened, with everything in it made short."""
    folder = tmp_path / "study"
    shutil.copytree(resolve(SLUG), folder)
    said = (folder / "study.yaml").read_text(encoding="utf-8")
    for whole, part in (
        ("queries_per_trial: 30", f"queries_per_trial: {QUERIES}"),
        ("{videos: 100, required: 100}", f"{{videos: {VIDEOS}, required: {VIDEOS}}}"),
    ):
        assert whole in said
        said = said.replace(whole, part)
    (folder / "study.yaml").write_text(said, encoding="utf-8")
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, SLUG)
    return repository.find(app, SLUG).plan


def passed(session: Session, clock: Clock) -> list[tuple[str, int, int]]:
    """Go all the way: each stage with the trial and the query that the page says."""
    stages: list[tuple[str, int, int]] = []
    while (stage := session.state["stage"]) != "completed":
        at = session.state["progress"]
        stages.append((stage, at["trial"], at["query"]))
        if stage == "familiarisation":
            # Not before all were watched.
            assert session.go_on().status_code == 409
            for index in range(VIDEOS):
                assert session.call("watched", {"index": index}).status_code == 200
        if stage == "break":
            assert session.go_on().status_code == 409
        assert session.step("left", clock.forward).status_code == 200
    return stages


def test_a_session_of_both_kinds_of_waste_three_ways_and_three_trials_of_each(
    client: Api, app: AppContext, plan: Plan, clock: Clock
) -> None:
    session = client.start(SLUG)
    stages = passed(session, clock)

    trials = len(plan.conditions) * plan.trials_per_condition
    assert trials == 18
    expected = ["consent", "instructions"]
    for trial in range(trials):
        if trial % 9 == 0:
            expected.append("familiarisation")
        expected += ["query"] * QUERIES
        if trial < trials - 1:
            expected.append("break")
    expected.append("debrief")
    assert [stage for stage, _, _ in stages] == expected
    asked = [(trial, query) for stage, trial, query in stages if stage == "query"]
    assert asked == [(t, q) for t in range(1, trials + 1) for q in range(1, QUERIES + 1)]


def test_twelve_people_go_through_twelve_balanced_orders(
    client: Api, app: AppContext, plan: Plan, clock: Clock
) -> None:
    for _ in range(12):
        client.start(SLUG)
    with app.database.read() as db:
        rows = db.query(SessionRow).all()
        orders = [(row.order_index, tuple(row.trial_conditions)) for row in rows]
    assert Counter(index for index, _ in orders) == dict.fromkeys(range(12), 1)
    for index, conditions in orders:
        assert conditions == trial_conditions(plan, plan_orders(plan)[index])
        environments = [plan.conditions[place].environment for place in conditions]
        assert len(set(environments[:9])) == len(set(environments[9:])) == 1
        assert Counter(conditions) == dict.fromkeys(range(6), 3)
    assert Counter(conditions[0] for _, conditions in orders) == dict.fromkeys(range(6), 2)
