"""Figures of a study with checks: every finished trial is in, and what counts is said."""

from __future__ import annotations

import pandas as pd
import pytest

from app.services.context import AppContext
from app.services.export.table import Request
from app.services.results import registry, trial_learning
from app.services.results.result import Result
from app.services.studies import repository
from tests.conftest import Clock, StudyShelf

from .client import Api, by_turns
from .conftest import LEARNING_PLAN
from .test_checks import table

#: Of 12 queries and 9 checks, the tenth pair shown is a check in some trials.
CHECKED = (
    LEARNING_PLAN.replace("queries_per_trial: 5", "queries_per_trial: 12")
    + "checks: {repeats: 0.4, attention: 0.3}\n"
)
CONDITIONS = 3
PEOPLE = 3


def walk(client: Api, clock: Clock) -> None:
    for _ in range(PEOPLE):
        client.start().to_the_end(by_turns("left", "right", "skip", "left"), clock.forward)


def found(app: AppContext, name: str) -> Result:
    return registry.find(app, Request(repository.find(app, "short")), name)


def real(queries: pd.DataFrame) -> pd.DataFrame:
    return queries[queries["trial_type"].isin(["random", "model"])].dropna(subset="response")


@pytest.mark.parametrize("in_model", [False, True])
def test_every_finished_trial_is_in_the_violins_and_tests(
    app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock, in_model: bool
) -> None:
    plan = CHECKED.replace("0.3}", "0.3, in_model: true}") if in_model else CHECKED
    study_shelf.put_into(app, plan)
    walk(client, clock)
    scores = found(app, "acquired-scores")
    rows = pd.DataFrame(scores.rows)
    looks = [10, 20, 21] if in_model else [10, 12]
    trials = PEOPLE * CONDITIONS
    assert dict(rows["answers"].value_counts()) == dict.fromkeys(looks, trials)
    assert {test["trials"] for test in scores.extra["tests"]} == {(PEOPLE, PEOPLE)}

    queries = table(app, "queries").dropna(subset="response")
    taught = queries if in_model else real(queries)
    acquired = table(app, "acquired").set_index(["session_id", "trial_index", "query_index"])
    for row in rows.to_dict("records"):
        of_trial = taught[
            (taught["session_id"] == row["session_id"])
            & (taught["trial_index"] == row["trial_index"])
        ].sort_values("query_index")
        at = of_trial["query_index"].iloc[row["answers"] - 1]
        held = acquired.loc[(row["session_id"], row["trial_index"], at), "candidate"]
        assert row["candidate"] == held
    assert ("the model learns from them" in scores.says) == in_model
    assert ("attention checks) are not" in scores.says) != in_model


def test_a_trial_under_way_is_looked_at_as_far_as_it_came(
    app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock
) -> None:
    study_shelf.put_into(app, CHECKED)
    session = client.start().to_first_query()
    while len(real(table(app, "queries"))) < 9:
        assert session.respond("left").status_code == 200
    assert not found(app, "acquired-scores").rows
    while len(real(table(app, "queries"))) < 10:
        assert session.respond("left").status_code == 200
    assert [row["answers"] for row in found(app, "acquired-scores").rows] == [10]


def test_skips_and_sides_leave_checks_out_and_say_so(
    app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock
) -> None:
    study_shelf.put_into(app, CHECKED)
    walk(client, clock)
    queries = real(table(app, "queries"))
    skips, sides = found(app, "skips"), found(app, "sides")
    offered = queries[queries["condition"].isin(["pbpo", "no-synthesis"])]
    assert sum(row["answers"] for row in skips.rows) == len(offered)
    assert sum(row["choices"] for row in sides.rows) == (queries["response"] != "skip").sum()
    for told in (skips, sides):
        assert "Checks (repeats and attention checks) are left out." in told.notes
    assert "Answers to checks are among them." in found(app, "response-times").says


def test_the_path_of_a_trial_and_its_posterior_count_alike(
    app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock
) -> None:
    study_shelf.put_into(app, CHECKED)
    walk(client, clock)
    study = repository.find(app, "short")
    session_id = table(app, "queries")["session_id"].iloc[0]
    path, posterior = (
        trial_learning.find(app, study, session_id, 0, name) for name in ("path", "posterior")
    )
    assert len(path.rows) == 12
    assert "after 12 answers" in path.says
    assert "9 checks are not" in path.says
    assert posterior.says.startswith("After 12 answers")
