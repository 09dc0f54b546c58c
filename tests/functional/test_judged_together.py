"""Everybody's answers judged together: tables, reasons in words, and deletion."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from app.pbbo.people_summary import PeopleSummary
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.proposals import people_summaries
from app.services.proposals.people_summaries import (
    PeopleRequest,
    PeopleSummaries,
    compute_summary,
)
from app.services.results.people import PEOPLE_FINDINGS
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

    report = html.unescape(desk.get("/studies/short/data/report.html").text)
    assert report.index("People judged together") < report.index("Quality of the data")
    assert report.count("3 people together like Opening time") == 3 + 3  # said, and of the figure
    assert report.count("15 of 15 choices were on the left") == 3

    assert app.proposer.people.seeds()
    for person in sessions["participant_id"][1:]:
        assert desk.post("/studies/short/people/delete", participant=person).status_code == 303
    assert len(table(app, "sessions")) == 1
    assert table(app, "people").empty
    assert not app.proposer.people.seeds() & set(table(app, "trials")["seed"])


def test_the_page_says_what_people_like_and_gives_every_flag_its_reason(
    app: AppContext, desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = "/studies/short/results/people?mode=live&condition=pbpo"
    assert (
        'href="/studies/short/results/people?mode=live"' in desk.get("/studies/short/results").text
    )
    # Many answers are summarised in the background: here in no time, and not at all at first.
    monkeypatch.setattr(people_summaries, "FEW_ANSWERS", 0)
    started: list[Callable[[], None]] = []
    monkeypatch.setattr(f"{people_summaries.__name__}.Thread", partial(Later, started))
    page = desk.get(address).text
    assert "Being computed: 15 answers of 3 people" in page
    assert '<meta http-equiv="refresh"' in page
    assert desk.get(address).text.count("Being computed") == 1
    assert len(started) == 1
    monkeypatch.setattr(people_summaries.PeopleSummaries, "_in_child", in_this_process)
    started[0]()
    page = desk.get(address).text
    assert "3 people together like Opening time" in page
    assert "Something speaks against relying on 3 of 3 people" in page
    assert page.count("15 of 15 choices were on the left") == 1
    assert page.count('href="#reasons-heading"') == 3
    for name in PEOPLE_FINDINGS:
        [figure] = re.findall(rf'data-figure="([^"]+/{name}\.json[^"]+)"', page)
        drawn = desk.get(html.unescape(figure)).json()
        assert drawn["chart"] is not None, name
        assert drawn["says"]
    rows = desk.get("/studies/short/results/people/noise.csv?condition=pbpo").text.splitlines()
    assert len(rows) == 4
    assert desk.get("/studies/short/results/people?condition=other").status_code == 404
    assert "no one has answered" in desk.get("/studies/short/results/people?mode=pilot").text


class Later:
    """A thread that runs when the test says so."""

    def __init__(
        self, started: list[Callable[[], None]], *, target: Any, args: Any, daemon: bool
    ) -> None:
        assert daemon
        self._started, self._run = started, lambda: target(*args)

    def start(self) -> None:
        self._started.append(self._run)


def in_this_process(_summaries: PeopleSummaries, request: PeopleRequest) -> PeopleSummary:
    return compute_summary(request)
