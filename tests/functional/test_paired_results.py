"""Tests between conditions: paired per person, corrected, and said so where they are read."""

from __future__ import annotations

import pandas as pd
import pytest
from scipy import stats

from app.services.context import AppContext
from app.services.export.table import Request
from app.services.results import registry
from app.services.results.result import Result
from app.services.studies import repository
from tests.conftest import Clock, StudyShelf

from .client import Api, by_turns
from .conftest import LEARNING_PLAN

TWO_TRIALS = LEARNING_PLAN.replace("trials_per_condition: 1", "trials_per_condition: 2")
PRIMARY = TWO_TRIALS + "analysis: {primary: [no-skip, pbpo], score_unit: kg}\n"
PEOPLE = 3


def scores(app: AppContext, client: Api, clock: Clock) -> Result:
    for person in range(PEOPLE):
        presses = [("left", "right", "skip"), ("right", "left"), ("left",)][person]
        client.start().to_the_end(by_turns(*presses), clock.forward)
    return registry.find(app, Request(repository.find(app, "short")), "acquired-scores")


def test_the_people_are_paired_on_the_means_over_their_trials(
    app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock
) -> None:
    study_shelf.put_into(app, TWO_TRIALS)
    found = scores(app, client, clock)
    rows = pd.DataFrame(found.rows)
    means = rows.groupby(["condition", "participant_id"])["score"].mean()
    tests = found.extra["tests"]
    assert [(test["first"], test["second"]) for test in tests] == [
        ("pbpo", "no-synthesis"),
        ("pbpo", "no-skip"),
        ("no-synthesis", "no-skip"),
    ]
    for test in tests:
        known = stats.ttest_rel(means[test["first"]], means[test["second"]])
        assert test["paired"].people == PEOPLE
        assert (test["paired"].t, test["paired"].p) == pytest.approx(
            (known.statistic, known.pvalue)
        )
        # The paper's test beside it takes every trial as a person of its own.
        assert test["trials"] == (2 * PEOPLE, 2 * PEOPLE)
        welch = stats.ttest_ind(
            *(rows[rows["condition"] == test[side]]["score"] for side in ("first", "second")),
            equal_var=False,
        )
        assert test["unpaired"].welch_p == pytest.approx(welch.pvalue)
    raw = sorted(test["paired"].p for test in tests)
    assert min(test["adjusted"] for test in tests) == pytest.approx(min(1, 3 * raw[0]))


def test_page_and_report_say_which_test_counts_and_that_it_is_corrected(
    app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock
) -> None:
    study_shelf.put_into(app, TWO_TRIALS)
    found = scores(app, client, clock)
    said = " ".join(found.notes)
    assert "the test that counts is the paired t-test" in said
    assert "Holm's method corrects all 3 p-values together" in said
    assert "2 of them: they can find too much" in said
    described, paired, unpaired = found.summaries
    assert [row[3:5] for row in described.rows] == [("6", "3")] * 3
    assert described.caption.endswith("in g")
    assert "p (Holm)" in paired.header
    assert "Welch's p" in unpaired.header
    for summary in found.summaries:
        assert {len(row) for row in summary.rows} == {len(summary.header)}


def test_the_primary_comparison_of_the_plan_is_not_corrected(
    app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock
) -> None:
    study_shelf.put_into(app, PRIMARY)
    found = scores(app, client, clock)
    [primary] = [test for test in found.extra["tests"] if test["primary"]]
    assert {primary["first"], primary["second"]} == {"pbpo", "no-skip"}
    assert primary["adjusted"] == primary["paired"].p
    others = [test for test in found.extra["tests"] if not test["primary"]]
    smallest = min(others, key=lambda test: test["paired"].p)
    assert smallest["adjusted"] == pytest.approx(min(1, 2 * smallest["paired"].p))
    assert "no-skip against pbpo" in " ".join(found.notes)
    assert found.summaries[0].caption.endswith("in kg")
