"""Repeats and attention checks: shown among the others, flagged, and kept from the model."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pandas as pd
import pytest

from app.services.context import AppContext
from app.services.sessions import replay as replaying
from app.services.studies import repository
from tests.conftest import Clock, StudyShelf

from .client import Api, Session, by_turns
from .conftest import LEARNING_PLAN

QUERIES, REPEATS, ATTENTION = 10, 3, 2
CHECKED_PLAN = (
    LEARNING_PLAN.replace("queries_per_trial: 5", f"queries_per_trial: {QUERIES}")
    + "checks: {repeats: 0.3, attention: 0.2}\n"
)
TAUGHT_PLAN = CHECKED_PLAN.replace("attention: 0.2", "attention: 0.2, in_model: true")
ONLY_ONE = """
conditions:
  - name: pbpo
    method: pbpo
    environment: env1
    skip: {label: {en: I don't like either.}}
    settings: {preset: paper-env1, random_queries: 2}
trials_per_condition: 1
"""


def one_condition(plan: str) -> str:
    start, end = plan.index("conditions:"), plan.index("trials_per_condition: 1\n")
    return plan[:start] + ONLY_ONE.lstrip() + plan[end + len("trials_per_condition: 1\n") :]


Walk = Callable[[str], Session]


@pytest.fixture
def walk(app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock) -> Walk:
    """One evaluator through one trial of this plan."""

    def through(plan: str) -> Session:
        study_shelf.put_into(app, one_condition(plan))
        session = client.start()
        session.to_the_end(by_turns("left", "right", "skip", "left"), clock.forward)
        return session

    return through


def table(app: AppContext, name: str) -> pd.DataFrame:
    import io

    from app.services.export import TABLES, Request, csv_stream

    request = Request(repository.find(app, "short"))
    return pd.read_csv(io.BytesIO(b"".join(csv_stream(app, TABLES[name], request))))


def rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(key): value for key, value in row.items()} for _, row in table.iterrows()]


def test_checks_come_in_addition_and_are_counted_for_the_person(
    walk: Walk, app: AppContext
) -> None:
    session = walk(CHECKED_PLAN)
    shown = QUERIES + REPEATS + ATTENTION
    assert session.state["progress"] == {"trial": 1, "trials": 1, "query": shown, "queries": shown}
    queries = table(app, "queries")
    assert queries["query_index"].to_list() == list(range(shown))
    kinds = queries["trial_type"].value_counts()
    assert (kinds["repeat"], kinds["attention"]) == (REPEATS, ATTENTION)
    assert kinds["random"] + kinds["model"] == QUERIES


def test_a_repeat_shows_an_earlier_pair_with_its_sides_swapped(walk: Walk, app: AppContext) -> None:
    walk(CHECKED_PLAN)
    queries = table(app, "queries").set_index("query_index")
    checks = table(app, "checks")
    repeats = checks[checks["check"] == "repeat"]
    assert repeats["repeats_query_index"].is_unique
    swapped = {"left": "right", "right": "left", "skip": "skip"}
    for row in rows(repeats):
        again, earlier = queries.loc[row["query_index"]], queries.loc[row["repeats_query_index"]]
        assert row["query_index"] - row["repeats_query_index"] > 1
        assert earlier["trial_type"] in ("random", "model")
        assert again["left_recording"] == earlier["right_recording"]
        assert again["right_recording"] == earlier["left_recording"]
        assert row["expected"] == swapped[earlier["response"]]
        assert row["passed"] == (again["response"] == row["expected"])


def test_an_attention_check_sets_a_recording_among_the_worst_against_one_among_the_best(
    walk: Walk, app: AppContext
) -> None:
    walk(CHECKED_PLAN)
    scores = table(app, "recordings").set_index("recording")["score"]
    best, worst = scores.quantile(0.9), scores.quantile(0.1)
    queries = table(app, "queries").set_index("query_index")
    checks = table(app, "checks")
    for row in rows(checks[checks["check"] == "attention"]):
        query = queries.loc[row["query_index"]]
        good, bad = row["expected"], {"left": "right", "right": "left"}[row["expected"]]
        assert scores[query[f"{good}_recording"]] >= best
        assert scores[query[f"{bad}_recording"]] <= worst
        assert row["passed"] == (query["response"] == good)


def test_named_candidates_are_the_good_and_the_bad_ones(walk: Walk, app: AppContext) -> None:
    named = "attention: 0.2, good: [{w0: 0.5, w1: 0.5}], bad: [{w0: 1, w1: 0}, {w0: 1, w1: 1}]"
    walk(CHECKED_PLAN.replace("attention: 0.2", named))
    queries = table(app, "queries")
    checked = queries[queries["trial_type"] == "attention"]
    assert len(checked) == ATTENTION
    for _, query in checked.iterrows():
        good = query["acquisition"].removeprefix("good-")
        bad = {"left": "right", "right": "left"}[good]
        assert (query[f"{good}_w0"], query[f"{good}_w1"]) == (0.5, 0.5)
        assert query[f"{bad}_w0"] == 1


def test_checks_are_kept_from_the_model(walk: Walk, app: AppContext) -> None:
    walk(CHECKED_PLAN)
    queries = table(app, "queries").set_index("query_index")
    asked = queries[queries["trial_type"].isin(["random", "model"])]
    preferences, acquired = table(app, "preferences"), table(app, "acquired")
    assert acquired["query_index"].to_list() == asked.index.to_list()
    assert set(preferences["query_index"]) <= set(asked.index)
    answers = preferences[preferences["origin"] == "answer"].set_index("query_index")
    assert answers["winner"].to_list() == asked.loc[answers.index, "chosen_candidate"].to_list()
    made = preferences[preferences["origin"] == "synthesis"]
    drawn = asked.loc[made["drawn_from_query_index"]]
    assert drawn["chosen_candidate"].to_list() == made["winner"].to_list()


def test_the_model_learns_from_checks_where_the_plan_says_so(walk: Walk, app: AppContext) -> None:
    walk(TAUGHT_PLAN)
    queries, preferences = table(app, "queries"), table(app, "preferences")
    assert len(table(app, "acquired")) == len(queries)
    answered = queries.loc[queries["response"] != "skip", "query_index"]
    answers = preferences[preferences["origin"] == "answer"]
    assert answers["query_index"].to_list() == answered.to_list()


@pytest.mark.parametrize("plan", [CHECKED_PLAN, TAUGHT_PLAN])
def test_every_query_follows_again_from_what_is_stored(
    walk: Walk, app: AppContext, plan: str
) -> None:
    walk(plan)
    (trial,) = replaying.replay(app, "short")
    assert trial.queries == QUERIES + REPEATS + ATTENTION
    assert trial.differences == ()


def test_nothing_tells_the_page_which_query_is_a_check(
    app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock
) -> None:
    study_shelf.put_into(app, one_condition(CHECKED_PLAN))
    session = client.start().to_first_query()
    forms = set()
    while session.state["stage"] == "query":
        assert not {"repeat", "attention"} & set(json.dumps(session.state).split('"'))
        forms.add(form_of(session.state))
        session.respond("left")
    assert len(forms) == 1


def form_of(state: dict[str, Any]) -> str:
    """The state's keys, whatever stands behind them."""
    return json.dumps({key: sorted(value) for key, value in state.items() if key == "query"})


def test_a_check_that_did_not_play_is_replaced_by_one_of_its_kind(
    app: AppContext, study_shelf: StudyShelf, client: Api
) -> None:
    study_shelf.put_into(app, one_condition(CHECKED_PLAN))
    session = client.start().to_first_query()
    while session.state["stage"] == "query":
        session.call("faults", {"query_id": session.state["query"]["id"]})
        assert session.respond("left").status_code == 200
    queries, faults = table(app, "queries"), table(app, "faults")
    assert queries["trial_type"].to_list() == faults["trial_type"].to_list()
    checks = table(app, "checks")
    assert checks["repeats_query_index"].notna().sum() == REPEATS
    assert len(table(app, "acquired")) == QUERIES
