"""Results begin with what is liked best: named, played, and how sure that is."""

from __future__ import annotations

import re

import numpy as np
import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.export.table import Request
from app.services.results.liked_best import _Trial, liked_best, summarise
from app.services.studies import repository
from tests.conftest import Clock, StudyShelf

from .client import Api, by_turns
from .conftest import LEARNING_PLAN
from .desk import Desk
from .test_checks import table


def trial(person: str, *liking: float) -> _Trial:
    return _Trial(person, "main", int(np.argmax(liking)), np.array(liking))


def test_everybody_counts_once_however_many_trials_they_have() -> None:
    trials = [trial("a", 1.0, 0.0, 0.5)] * 5 + [
        trial("b", 0.0, 1.0, 0.9),
        trial("c", 0.1, 1.0, 0.9),
    ]
    found = summarise("kitchen", None, trials)
    assert (found.people, found.trials) == (3, 7)
    assert (found.best, found.runner_up) == (2, 1)
    assert (found.agree, found.acquired) == (1, 0)


def test_people_who_agree_make_it_sure_and_one_alone_does_not() -> None:
    alike = [trial(str(person), 0.0, 1.0, 0.1) for person in range(8)]
    assert summarise("kitchen", None, alike).sure == 1.0
    split = [trial(str(person), float(person % 2), 1.0 - person % 2) for person in range(8)]
    found = summarise("kitchen", None, split).sure
    assert found is not None
    assert 0.4 < found < 0.8
    assert summarise("kitchen", None, alike[:1]).sure is None


@pytest.fixture
def walked(app: AppContext, study_shelf: StudyShelf, client: Api, clock: Clock) -> Desk:
    study_shelf.put_into(app, LEARNING_PLAN)
    for _ in range(2):
        client.start().to_the_end(by_turns("left", "right", "left"), clock.forward)
    return Desk(client, app, "mo@lab.example", Role.ADMIN)


def test_the_answer_is_given_in_all_and_under_each_condition(app: AppContext, walked: Desk) -> None:
    found = liked_best(app, Request(repository.find(app, "short")))
    assert [one.condition for one in found] == [None, "pbpo", "no-synthesis", "no-skip"]
    assert [(one.people, one.trials) for one in found] == [(2, 6), (2, 2), (2, 2), (2, 2)]
    acquired = table(app, "acquired").groupby(["session_id", "trial_index"]).last()
    assert found[0].acquired == (acquired["candidate"] == found[0].best).sum()


def test_the_page_says_it_in_the_studys_own_words_with_both_videos(walked: Desk) -> None:
    page = walked.get("/studies/short/results").text
    assert page.index("What is liked best") < page.index("Figures")
    [address] = re.findall(r'data-answer="([^"]+)"', page)
    answer = walked.get(address).text
    assert re.search(r"Opening time [\d.]+ s, Closing time [\d.]+ s", answer)
    assert "Runner-up" in answer
    assert answer.count("data-plays") == 2
    assert "people like it at least as much as the runner-up" in answer
    assert re.search(r"Sureness: \d+ %", answer)


def test_a_study_without_a_finished_trial_says_so(
    app: AppContext, study_shelf: StudyShelf, client: Api
) -> None:
    study_shelf.put_into(app, LEARNING_PLAN)
    desk = Desk(client, app, "mo@lab.example", Role.ADMIN)
    assert "No trial is finished yet." in desk.get("/studies/short/results/answer").text
