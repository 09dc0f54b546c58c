"""Everybody's answers judged together: tables, reasons in words, and deletion."""

from __future__ import annotations

import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from tests.conftest import Clock, StudyShelf

from .client import Api, by_turns
from .conftest import LEARNING_PLAN
from .desk import Desk
from .test_checks import table


@pytest.fixture
def desk(app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock) -> Desk:
    study_shelf.put_into(app, LEARNING_PLAN)
    for answers in (("left", "right", "left"), ("right", "skip", "left"), ("left",)):
        client.start().to_the_end(by_turns(*answers), clock.forward)
    return Desk(client, app, "mo@lab.example", Role.ADMIN)


def test_people_and_the_population_are_exported_and_leave_with_a_session(
    app: AppContext, desk: Desk
) -> None:
    people, sessions = table(app, "people"), table(app, "sessions")
    assert set(people["condition"]) == {"pbpo", "no-synthesis", "no-skip"}
    assert (people["responses"] == 5).all()
    # All of them answer at once; only the third always on the left.
    assert people["flagged"].all()
    assert people["reasons"].str.contains("15 of 15 answers came within 1.5 s").all()
    one_sided = people[people["reasons"].str.contains("15 of 15 choices were on the left")]
    assert set(one_sided["participant_id"]) == {sessions["participant_id"].iloc[-1]}
    assert len(one_sided) == 3
    # Without a skip nothing is known of a threshold.
    assert people.query("condition == 'no-skip'")["threshold"].isna().all()
    assert people.query("condition == 'pbpo'")["threshold"].notna().all()
    population = table(app, "population")
    best = population[population["is_best"]]
    assert list(best["condition"]) == ["pbpo", "no-synthesis", "no-skip"]
    assert (population.groupby("condition")["times_shown"].sum() == 2 * 5 * 3).all()
    assert population.groupby("condition")["best_probability"].sum().to_numpy() == pytest.approx(1)

    assert app.proposer.people.seeds()
    for person in sessions["participant_id"][1:]:
        assert desk.post("/studies/short/people/delete", participant=person).status_code == 303
    assert len(table(app, "sessions")) == 1
    assert table(app, "people").empty
    assert not app.proposer.people.seeds() & set(table(app, "trials")["seed"])
