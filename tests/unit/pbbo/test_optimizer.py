"""The ask/tell door: what a caller may rely on, whatever the mathematics behind it."""

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from app.pbbo import (
    METHODS,
    PRESETS,
    NoPosteriorError,
    PreferenceOptimizer,
    Query,
    QueryNotAskedError,
    Response,
    Settings,
    SkipNotOfferedError,
    UnknownMethodError,
    UnknownResponseError,
    allows_skip,
    has_posterior,
    model,
)
from app.pbbo.candidates import FloatArray

STEP = 0.05
TRIANGLE: FloatArray = np.array([(i * STEP, j * STEP) for i in range(21) for j in range(i + 1)])
PEAK = np.array([0.7, 0.4])


def height(index: int) -> float:
    """A hill over the triangle, best at PEAK."""
    return -float(np.linalg.norm(TRIANGLE[index] - PEAK))


def answer(method: str, query: Query, skip_below: float = -0.45) -> Response:
    """An evaluator who always picks the higher one, and skips where both are low."""
    left, right = height(query.left), height(query.right)
    if allows_skip(method) and max(left, right) < skip_below:
        return "skip"
    return "left" if left >= right else "right"


def trial(method: str, seed: int, queries: int) -> PreferenceOptimizer:
    optimizer = PreferenceOptimizer(TRIANGLE, method, seed)
    for _ in range(queries):
        query = optimizer.ask()
        optimizer.tell(query, answer(method, query))
    return optimizer


@pytest.mark.parametrize("method", METHODS)
def test_thirty_certain_answers_find_a_better_candidate_than_most(method: str) -> None:
    regrets = [-height(trial(method, seed, 30).best()) for seed in range(5)]

    by_chance = float(np.mean([-height(i) for i in range(len(TRIANGLE))]))
    assert np.mean(regrets) < 0.6 * by_chance


@pytest.mark.parametrize("method", METHODS)
def test_asking_twice_gives_the_same_query(method: str) -> None:
    optimizer = trial(method, 3, 9)

    assert optimizer.ask() is optimizer.ask()


@pytest.mark.parametrize("method", METHODS)
def test_a_replayed_optimiser_goes_on_exactly_where_the_first_one_is(method: str) -> None:
    history: list[tuple[int, int, str]] = []
    optimizer = PreferenceOptimizer(TRIANGLE, method, 11)
    for _ in range(14):
        replayed = PreferenceOptimizer.replay(TRIANGLE, history, method=method, seed=11)
        query = optimizer.ask()
        assert replayed.ask() == query
        assert replayed.best() == optimizer.best()
        assert replayed.preferences == optimizer.preferences
        response = answer(method, query)
        optimizer.tell(query, response)
        history.append((query.left, query.right, response))


def test_another_process_asks_the_same_query() -> None:
    history = [(5, 100, "left"), (30, 100, "right"), (7, 8, "skip"), (9, 5, "left")]
    history += [(200, 5, "right"), (5, 60, "left"), (77, 5, "left")]
    program = (
        "import numpy as np; from app.pbbo import PreferenceOptimizer as P;"
        "c = np.array([(i * 0.05, j * 0.05) for i in range(21) for j in range(i + 1)]);"
        f"print(P.replay(c, {history!r}, method='pbpo', seed=5).ask())"
    )

    elsewhere = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.strip()

    here = PreferenceOptimizer.replay(TRIANGLE, history, method="pbpo", seed=5).ask()
    assert here.acquisition == "thompson"
    assert elsewhere == repr(here)


@pytest.mark.parametrize("method", METHODS)
def test_no_query_compares_a_candidate_with_itself_or_repeats_the_last_pair(method: str) -> None:
    few = np.array([[0.0], [0.4], [1.0]])
    for seed in range(4):
        optimizer = PreferenceOptimizer(few, method, seed)
        last: frozenset[int] = frozenset()
        for _ in range(25):
            query = optimizer.ask()
            assert query.left != query.right
            assert frozenset((query.left, query.right)) != last
            last = frozenset((query.left, query.right))
            optimizer.tell(query, "left" if query.left < query.right else "right")


@pytest.mark.parametrize("method", METHODS)
def test_two_candidates_can_be_compared_again_and_again(method: str) -> None:
    optimizer = PreferenceOptimizer([[0.0], [1.0]], method, 0)
    for _ in range(12):
        query = optimizer.ask()
        assert {query.left, query.right} == {0, 1}
        optimizer.tell(query, "left" if query.left == 1 else "right")

    assert optimizer.best() == 1


@pytest.mark.parametrize("method", ["pbpo", "pbpo-no-synthesis"])
def test_queries_stay_random_until_five_answers_that_are_not_skips(method: str) -> None:
    optimizer = PreferenceOptimizer(TRIANGLE, method, 2)
    responses: list[Response] = ["skip", "left", "skip", "left", "right", "skip", "left"]
    for response in responses:
        query = optimizer.ask()
        assert (query.trial_type, query.acquisition) == ("random", "random")
        optimizer.tell(query, response)
    assert optimizer.ask().trial_type == "random"

    optimizer.tell(optimizer.ask(), "right")

    assert (optimizer.ask().trial_type, optimizer.ask().acquisition) == ("model", "thompson")
    assert optimizer.ask().index == len(responses) + 1


def test_a_trial_of_skips_alone_goes_on_asking_random_queries() -> None:
    optimizer = PreferenceOptimizer(TRIANGLE, "pbpo", 4)
    for _ in range(30):
        optimizer.tell(optimizer.ask(), "skip")

    assert optimizer.ask().trial_type == "random"
    assert optimizer.preferences == ()
    assert optimizer.best() == PreferenceOptimizer(TRIANGLE, "pbpo", 4).best()


def test_the_better_candidate_appears_on_either_side() -> None:
    lefts = 0
    for seed in range(200):
        query = PreferenceOptimizer(TRIANGLE, "pbpo", seed).ask()
        lefts += query.left < query.right

    assert 70 < lefts < 130


def test_seeds_give_different_trials() -> None:
    assert len({PreferenceOptimizer(TRIANGLE, "pbpo", seed).ask().left for seed in range(40)}) > 20


def test_the_seed_of_a_query_is_recorded_with_it() -> None:
    assert PreferenceOptimizer(TRIANGLE, "pbpo", 123).ask().seed == 123


def test_knockout_keeps_the_winner_and_brings_a_new_opponent() -> None:
    optimizer = PreferenceOptimizer(TRIANGLE, "knockout", 6)
    first = optimizer.ask()
    assert (first.trial_type, first.acquisition) == ("random", "random")
    optimizer.tell(first, "left")

    second = optimizer.ask()

    assert optimizer.best() == first.left
    assert first.left in (second.left, second.right)
    assert second.acquisition == "knockout"


def test_the_acquired_candidate_has_the_largest_posterior_mean() -> None:
    optimizer = trial("pbpo", 8, 12)

    mean, std = optimizer.posterior()

    assert mean.shape == std.shape == (len(TRIANGLE),)
    assert optimizer.best() == int(np.argmax(mean))
    assert (std > 0.0).all()


def test_before_any_preference_the_posterior_is_the_prior() -> None:
    mean, std = PreferenceOptimizer(TRIANGLE, settings=Settings(signal_variance=4.0)).posterior()

    assert mean == pytest.approx(np.zeros(len(TRIANGLE)))
    assert std == pytest.approx(np.full(len(TRIANGLE), 2.0))


def test_the_model_can_choose_from_the_first_query_on() -> None:
    optimizer = PreferenceOptimizer(TRIANGLE, settings=Settings(random_queries=0))

    assert optimizer.ask().acquisition == "thompson"


@pytest.mark.parametrize("preset", PRESETS)
def test_the_posterior_answers_to_what_the_caller_does_with_it(preset: str) -> None:
    optimizer = PreferenceOptimizer(TRIANGLE, settings=PRESETS[preset])
    optimizer.tell(optimizer.ask(), "left")
    mean, _ = optimizer.posterior()

    mean[:] = 0.0

    assert optimizer.posterior()[0].any()


def test_knockout_has_no_posterior() -> None:
    assert [name for name in METHODS if not has_posterior(name)] == ["knockout"]
    with pytest.raises(NoPosteriorError, match="knockout"):
        PreferenceOptimizer(TRIANGLE, "knockout").posterior()


@pytest.mark.parametrize("method", ["pbpo-no-skip", "knockout"])
def test_a_skip_is_refused_where_none_is_offered(method: str) -> None:
    optimizer = PreferenceOptimizer(TRIANGLE, method)
    query = optimizer.ask()

    with pytest.raises(SkipNotOfferedError, match=f"{method} offers no skip"):
        optimizer.tell(query, "skip")
    with pytest.raises(SkipNotOfferedError, match=r"history\[1\]"):
        PreferenceOptimizer.replay(TRIANGLE, [(0, 1, "left"), (2, 3, "skip")], method=method)
    assert optimizer.ask() == query


def test_a_response_before_any_query_is_refused() -> None:
    query = PreferenceOptimizer(TRIANGLE).ask()

    with pytest.raises(QueryNotAskedError, match=r"ask\(\) comes first"):
        PreferenceOptimizer(TRIANGLE).tell(query, "left")


def test_a_response_to_an_answered_or_foreign_query_is_refused() -> None:
    optimizer = PreferenceOptimizer(TRIANGLE)
    first = optimizer.ask()
    optimizer.tell(first, "left")
    optimizer.ask()

    with pytest.raises(QueryNotAskedError):
        optimizer.tell(first, "left")
    with pytest.raises(QueryNotAskedError):
        optimizer.tell(PreferenceOptimizer(TRIANGLE, seed=9).ask(), "left")
    assert optimizer.responses == 1


@pytest.mark.parametrize("response", ["both", "", None, 0, "LEFT"])
def test_an_unknown_response_is_refused(response: str) -> None:
    optimizer = PreferenceOptimizer(TRIANGLE)

    with pytest.raises(UnknownResponseError, match="expected left, right or skip"):
        optimizer.tell(optimizer.ask(), response)


def test_an_unknown_method_is_named_beside_those_there_are() -> None:
    with pytest.raises(UnknownMethodError, match=r"expected one of pbpo, .*got 'pbop'"):
        PreferenceOptimizer(TRIANGLE, "pbop")


def test_a_step_keeps_to_one_thread_and_leaves_the_caller_s_number_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def threads() -> set[int]:
        pools = ThreadpoolController().info()
        return {pool["num_threads"] for pool in pools if pool["user_api"] == "blas"}

    during: list[set[int]] = []

    def watched(*arguments: Any, **named: Any) -> Any:
        during.append(threads())
        return belief_over(*arguments, **named)

    belief_over = model.belief_over
    monkeypatch.setattr(model, "belief_over", watched)
    with ThreadpoolController().limit(limits=2):
        before = threads()
        PreferenceOptimizer.replay(TRIANGLE, [(0, 9, "left")]).posterior()

        assert during == [{1}]
        assert threads() == before
