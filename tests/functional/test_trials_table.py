"""Exports have a row per trial, and the condition wherever they have a trial."""

from __future__ import annotations

import pandas as pd
import pytest

from app.services.context import AppContext
from app.services.export import TABLES
from tests.conftest import Clock, StudyShelf

from .client import Api, by_turns
from .conftest import LEARNING_PLAN
from .test_checks import table

ASKING = (
    LEARNING_PLAN.replace("queries_per_trial: 5", "queries_per_trial: 10")
    + """checks: {repeats: 0.2}
practice: {queries: 1}
questionnaires:
  after_trial: [{name: effort, type: likert, points: 5, label: Effort}]
  end: [{name: age, type: number, min: 0, max: 99, label: Age}]
"""
)


@pytest.fixture
def walked(app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock) -> None:
    study_shelf.put_into(app, ASKING)
    client.start().to_the_end(by_turns("left", "skip", "right"), clock.forward)


@pytest.mark.usefixtures("walked")
def test_a_row_per_trial_has_its_times_counts_and_what_was_acquired(app: AppContext) -> None:
    trials = table(app, "trials")
    assert list(trials["trial_index"]) == [0, 1, 2]
    assert set(trials["condition"]) == {"pbpo", "no-synthesis", "no-skip"}
    queries = table(app, "queries").query("trial_index >= 0").groupby("trial_index")
    assert list(trials["responses"]) == list(queries["response"].count())
    assert list(trials["skips"]) == [
        (answers == "skip").sum() for _, answers in queries["response"]
    ]
    begun, ended = (pd.to_datetime(trials[name]) for name in ("started_at", "ended_at"))
    assert (begun < ended).all()
    last = table(app, "acquired").groupby("trial_index").last()
    for column in ("candidate", "w0", "w1", "posterior_mean", "posterior_std"):
        assert list(trials[column].dropna()) == list(last[column].dropna())


@pytest.mark.usefixtures("walked")
def test_every_table_with_a_trial_names_its_condition(app: AppContext) -> None:
    trials = table(app, "trials").set_index("trial_index")["condition"]
    seen = set()
    for name in TABLES:
        rows = table(app, name)
        if "trial_index" not in rows:
            continue
        seen.add(name)
        assert "condition" in rows, name
        for index, condition in zip(rows["trial_index"], rows["condition"], strict=True):
            if index >= 0:
                assert condition == trials[index], name
    assert {"acquired", "preferences", "events", "evidence", "questionnaires", "checks"} <= seen
    # -1 is the practice of queries, and no trial of questionnaires.
    ends = table(app, "questionnaires").query("trial_index == -1")
    assert len(ends) == 1
    assert ends["condition"].isna().all()
