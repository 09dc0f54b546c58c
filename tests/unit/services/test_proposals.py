"""What comes after a history: a pure function, worked out now or ahead."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from app.services.background.interface import Background
from app.services.background.local import LocalBackground
from app.services.context import AppContext
from app.services.proposals import computation, step_cache
from app.services.proposals.computation import History
from app.services.proposals.proposer import (
    CandidateSet,
    Proposer,
    RecordingRef,
    TrialSpec,
    next_step,
)
from tests.conftest import SHORT_PLAN, StudyShelf

SETTINGS = {"preset": "paper-env1", "random_queries": 2}
TRIAL = TrialSpec(
    study_id=1, environment="env1", method="pbpo", settings=SETTINGS, seed=5, queries=4
)


@pytest.fixture(scope="module")
def space() -> CandidateSet:
    """Nine candidates on a line, three clips of each."""
    clips = tuple(
        tuple(
            RecordingRef(3 * index + run, f"id{index}-{run}", 10.0, "crane", "", None)
            for run in range(3)
        )
        for index in range(9)
    )
    return CandidateSet(np.linspace(0, 1, 9)[:, None], clips)


def answered(space: CandidateSet, responses: list[str], trial: TrialSpec = TRIAL) -> History:
    history: History = ()
    for response in responses:
        following = next_step(space, trial, history).next
        assert following is not None
        history = (*history, (following.left_candidate, following.right_candidate, response))
    return history


def test_a_step_follows_from_its_arguments_alone(space: CandidateSet) -> None:
    history = answered(space, ["left", "skip", "right"])
    assert next_step(space, TRIAL, history) == next_step(space, TRIAL, history)
    other = replace(TRIAL, seed=6)
    assert next_step(space, TRIAL, ()).next != next_step(space, other, ()).next


def test_the_clips_are_of_the_candidates_on_their_sides(space: CandidateSet) -> None:
    for responses in ([], ["left"], ["left", "skip"]):
        following = next_step(space, TRIAL, answered(space, responses)).next
        assert following is not None
        assert following.query_index == len(responses)
        assert following.left in space.recordings[following.left_candidate]
        assert following.right in space.recordings[following.right_candidate]


def test_after_the_last_response_nothing_follows_but_what_was_learnt(space: CandidateSet) -> None:
    step = next_step(space, TRIAL, answered(space, ["left", "right", "left", "right"]))
    assert step.next is None
    assert len(step.preferences) == 4
    assert step.acquired is not None


def test_before_the_first_response_nothing_was_learnt(space: CandidateSet) -> None:
    step = next_step(space, TRIAL, ())
    assert step.preferences == ()
    assert step.acquired is None


def test_a_knockout_acquires_its_last_winner_without_a_posterior(space: CandidateSet) -> None:
    trial = replace(TRIAL, method="knockout")
    history = answered(space, ["left", "right"], trial)
    acquired = next_step(space, trial, history).acquired
    assert acquired is not None
    assert acquired.candidate == history[-1][1]
    assert (acquired.mean, acquired.std) == (None, None)


class Counted:
    """How often a step was worked out."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.times = 0
        real = computation.compute_step

        def counting(*args: object) -> object:
            self.times += 1
            return real(*args)  # type: ignore[arg-type]

        monkeypatch.setattr(computation, "compute_step", counting)


@pytest.fixture
def proposer(app: AppContext, study_shelf: StudyShelf) -> Proposer:
    study_shelf.put_into(app, SHORT_PLAN)
    return app.proposer


def test_a_step_is_worked_out_once(proposer: Proposer, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = Counted(monkeypatch)
    assert proposer.step(TRIAL, ()) is proposer.step(TRIAL, ())
    assert counted.times == 1


def test_what_was_worked_out_long_ago_is_forgotten_and_worked_out_alike(
    proposer: Proposer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(step_cache, "MAX_TRIALS", 2)
    monkeypatch.setattr(proposer, "_steps", step_cache.StepCache())
    first = proposer.step(TRIAL, ())
    for seed in (6, 7):
        proposer.step(replace(TRIAL, seed=seed), ())
    counted = Counted(monkeypatch)
    assert proposer.step(TRIAL, ()) == first
    assert counted.times == 1


def first_pair(proposer: Proposer) -> tuple[int, int]:
    first = proposer.step(TRIAL, ()).next
    assert first is not None
    return first.left_candidate, first.right_candidate


class TestWorkingAhead:
    @pytest.fixture
    def background(self) -> Background:
        return LocalBackground(1)

    def test_each_possible_response_is_worked_out_and_its_videos_begun(
        self, app: AppContext, study_shelf: StudyShelf
    ) -> None:
        study_shelf.put_into(app, SHORT_PLAN)
        begun: list[RecordingRef] = []
        proposer = Proposer(app.database, app.background, begun.append, app.metrics)
        pair = first_pair(proposer)
        assert proposer.possible_queries(TRIAL, (), pair) == []

        proposer.precompute(TRIAL, (), pair)
        app.background.in_thread("after that", lambda: None).result(30)

        upcoming = proposer.possible_queries(TRIAL, (), pair)
        assert len(upcoming) == 3
        assert {clip.id for clip in begun} == {
            clip.id for following in upcoming for clip in (following.left, following.right)
        }
        no_skip = replace(TRIAL, method="pbpo-no-skip", seed=6)
        proposer.precompute(no_skip, (), pair)
        app.background.in_thread("after that", lambda: None).result(30)
        assert len(proposer.possible_queries(no_skip, (), pair)) == 2
        proposer.close()

    def test_as_long_as_one_of_them_is_worked_out_none_is_told(
        self, app: AppContext, study_shelf: StudyShelf
    ) -> None:
        study_shelf.put_into(app, SHORT_PLAN)
        proposer = app.proposer
        pair = first_pair(proposer)
        # Answered before anything was worked out, and taken back.
        proposer.step(TRIAL, ((*pair, "left"),))
        assert proposer.possible_queries(TRIAL, (), pair) == []
        proposer.precompute(TRIAL, (), pair)
        app.background.in_thread("after that", lambda: None).result(30)
        assert len(proposer.possible_queries(TRIAL, (), pair)) == 3

    def test_what_was_answered_meanwhile_is_worked_out_no_further(
        self, app: AppContext, study_shelf: StudyShelf
    ) -> None:
        study_shelf.put_into(app, SHORT_PLAN)
        proposer = app.proposer
        pair = first_pair(proposer)
        answered = ((*pair, "left"),)
        busy = threading.Event()
        app.background.in_thread("busy", busy.wait, 30)

        proposer.precompute(TRIAL, (), pair)
        second = proposer.step(TRIAL, answered).next
        assert second is not None
        pair_then = (second.left_candidate, second.right_candidate)
        proposer.precompute(TRIAL, answered, pair_then)
        busy.set()
        app.background.in_thread("after that", lambda: None).result(30)

        assert proposer.cached_step(TRIAL, ((*pair, "right"),)) is None
        assert len(proposer.possible_queries(TRIAL, answered, pair_then)) == 3
