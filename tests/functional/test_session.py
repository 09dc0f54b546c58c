"""A session through the API, from arrival to the end, as the contract has it."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import pytest

from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api


def test_a_session_goes_from_consent_to_its_first_query(
    client: Api, short_study: StudyInfo
) -> None:
    session = client.start()
    assert session.state["stage"] == "consent"
    assert session.state["progress"] == {"trial": 0, "trials": 3, "query": 0, "queries": 4}

    assert session.consent().json()["stage"] == "instructions"
    familiarisation = session.go_on().json()
    assert familiarisation["stage"] == "familiarisation"
    assert len(familiarisation["familiarisation"]["videos"]) == 2
    query = session.go_on().json()
    assert query["stage"] == "query"
    assert query["progress"] == {"trial": 1, "trials": 3, "query": 1, "queries": 4}
    assert query["query"]["left"]["url"] != query["query"]["right"]["url"]
    assert query["query"]["left"]["duration_s"] == 10.0


def test_a_session_passes_through_every_trial_and_break_and_ends(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_first_query()

    stages = []
    for _ in range(3 * 4):
        session.respond("left")
        stages.append((session.state["stage"], session.state["progress"]["trial"]))
        if session.state["stage"] == "break":
            clock.forward(120)
            session.go_on()
            stages.append((session.state["stage"], session.state["progress"]["trial"]))

    one, two = [("query", 1)] * 3, [("query", 2)] * 4
    assert stages == [
        *one,
        ("break", 1),
        *two,
        ("break", 2),
        *[("query", 3)] * 4,
        ("debrief", 3),
    ]
    assert "taught an optimiser" in session.state["debrief"]["html"]
    assert session.go_on().json()["stage"] == "completed"
    assert session.look()["progress"] == {"trial": 3, "trials": 3, "query": 4, "queries": 4}


def test_each_trial_has_the_skip_button_of_its_own_condition_or_none(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_first_query()

    labels = []
    for _ in range(3):
        skip = session.state["query"]["skip"]
        labels.append(skip and skip["label"])
        while session.state["stage"] == "query":
            session.respond("right")
        clock.forward(120)
        session.go_on()

    assert sorted(labels, key=str) == ["I don't like either.", "It's hard to choose.", None]


def test_six_sessions_take_the_six_balanced_orders(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    for _ in range(6):
        client.start()
    conditions = client.table("sessions", api_token)["conditions"]
    orders = [tuple(names.split("; ")) for names in conditions]
    assert len(set(orders)) == 6
    for place in range(3):
        assert set(Counter(order[place] for order in orders).values()) == {2}
    followers = Counter(pair for order in orders for pair in pairwise(order))
    assert set(followers.values()) == {2}
    assert len(followers) == 6


def test_a_session_goes_through_its_conditions_in_the_order_it_was_given(
    client: Api, short_study: StudyInfo, api_token: str, clock: Clock
) -> None:
    client.start().to_the_end(lambda _: "left", clock.forward)
    queries = client.table("queries", api_token)
    walked = queries.groupby("trial_index")["condition"].first().to_list()
    given = client.table("sessions", api_token)["conditions"].iloc[0]
    assert walked == given.split("; ")


def test_somebody_who_left_long_ago_does_not_hold_a_place_in_the_balance(
    client: Api, short_study: StudyInfo, clock: Clock, api_token: str
) -> None:
    for _ in range(6):
        client.start()
    clock.forward(3601)
    for _ in range(6):
        client.start()

    rows = client.table("sessions", api_token)
    orders = rows["order_index"].to_list()
    assert sorted(orders[:6]) == sorted(orders[6:]) == list(range(6))


def test_withdrawing_does_not_hold_a_place_in_the_balance(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    leaves = client.start().to_first_query()
    others = [client.start() for _ in range(5)]
    assert leaves.call("withdraw").json()["stage"] == "withdrawn"
    client.start()

    orders = client.table("sessions", api_token)["order_index"].to_list()
    assert len(others) == 5
    assert orders[6] == orders[0]


def test_a_break_cannot_be_left_early_and_says_how_long_it_still_lasts(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_first_query()
    for _ in range(4):
        session.respond("left")
    rest = session.state["break"]
    assert (rest["ends_at"], rest["seconds_left"]) == ("2026-03-01T09:02:00Z", 120)
    assert set(rest) == {"ends_at", "seconds_left", "next_skip"}

    clock.forward(119.5)
    refusal = session.go_on()
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:break-not-over"
    assert refusal.json()["stage"] == "break"
    assert refusal.json()["seconds_left"] == 1
    assert session.look()["break"]["seconds_left"] == 1

    clock.forward(0.5)
    assert session.look()["break"]["seconds_left"] == 0
    assert session.go_on().json()["stage"] == "query"


def test_a_clock_that_is_set_back_by_hours_keeps_nobody_in_a_break(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_first_query()
    for _ in range(4):
        session.respond("left")
    clock.forward(-30)
    assert session.look()["break"]["seconds_left"] == 120
    assert session.go_on().json()["seconds_left"] == 120
    clock.forward(-7200)
    assert session.look()["break"]["seconds_left"] == 0
    assert session.go_on().json()["stage"] == "query"


def test_declining_ends_a_session_before_it_began(client: Api, short_study: StudyInfo) -> None:
    session = client.start()
    assert session.call("withdraw").json()["stage"] == "declined"
    assert session.look()["progress"]["trial"] == 0


@pytest.mark.parametrize("answered", [0, 2, 4])
def test_withdrawing_keeps_what_was_answered(
    client: Api, short_study: StudyInfo, api_token: str, answered: int
) -> None:
    session = client.start().to_first_query()
    for _ in range(answered):
        session.respond("right")
    assert session.call("withdraw").json()["stage"] == "withdrawn"

    queries = client.table("queries", api_token)
    assert queries["response"].dropna().to_list() == ["right"] * answered
    assert client.table("sessions", api_token)["stage"].to_list() == ["withdrawn"]


def test_looking_again_shows_the_same_query(client: Api, short_study: StudyInfo) -> None:
    session = client.start().to_first_query()
    shown = session.state["query"]
    for _ in range(3):
        again = session.look()["query"]
        assert (again["id"], again["left"], again["right"]) == (
            shown["id"],
            shown["left"],
            shown["right"],
        )
