"""Several people, one model: special cases, weights, concurrency, withdrawal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.pbbo import (
    Box,
    BoxOptimizer,
    HistoryError,
    PeopleSettings,
    PersonError,
    PreferenceOptimizer,
    QueryNotAskedError,
    Settings,
    SettingsError,
    variational,
)
from app.pbbo import people_model as people_model_module
from app.pbbo.candidates import FloatArray

AXIS = np.linspace(0.0, 1.0, 6)
GRID = np.array([(a, b) for a in AXIS for b in AXIS])
#: Everything in common and everything of one's own, without what only this model knows.
POOLED = PeopleSettings(
    own_shares=(0.0,),
    own_thresholds=0.0,
    side_variance=0.0,
    noises=(1.0,),
    noise_prior=(1.0,),
    growth=1.0,
)
SEPARATE = replace(POOLED, own_shares=(1.0,), own_thresholds=1.0)
ONE_SCALE = Settings(threshold_length_scales=(0.3,))

Entry = tuple[int, int, str, str | None, str]


def landscape(best: tuple[float, float]) -> FloatArray:
    return np.asarray(-4.0 * ((GRID - np.array(best)) ** 2).sum(axis=1))


def answers(
    people: dict[str, FloatArray], each: int, seed: int, *, ties: bool = False
) -> list[Entry]:
    """What people with these landscapes answer to random pairs, in turn."""
    rng = np.random.default_rng(seed)
    history: list[Entry] = []
    for _ in range(each):
        for name, f in people.items():
            left, right = (int(row) for row in rng.choice(len(GRID), 2, replace=False))
            if max(f[left], f[right]) < -2.5:
                history.append((left, right, "skip", "both_bad", name))
            elif ties and abs(f[left] - f[right]) < 0.15:
                history.append((left, right, "skip", "cannot_tell", name))
            else:
                better = f[left] - f[right] + 0.4 * rng.standard_normal() > 0.0
                history.append((left, right, "left" if better else "right", None, name))
    return history


def replayed(
    history: list[Entry], people: PeopleSettings | None = None, settings: Settings | None = None
) -> PreferenceOptimizer:
    return PreferenceOptimizer.replay(
        GRID, history, method="pbpo-threshold", settings=settings, people=people
    )


def alone(history: list[Entry], settings: Settings = ONE_SCALE) -> PreferenceOptimizer:
    return PreferenceOptimizer.replay(
        GRID, [entry[:4] for entry in history], method="pbpo-threshold", settings=settings
    )


@pytest.fixture
def converged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both inferences iterate until rounding stops them."""
    monkeypatch.setattr(variational, "TOLERANCE", 1e-12)
    monkeypatch.setattr(people_model_module, "CLOSE", 1e-12)


TWO = {"p1": landscape((0.2, 0.6)), "p2": landscape((0.8, 0.4))}


@pytest.mark.usefixtures("converged")
def test_without_own_taste_the_population_is_one_person_who_gave_all_answers() -> None:
    history = answers(TWO, 12, seed=1, ties=True)
    mean, std = replayed(history, POOLED, ONE_SCALE).posterior()
    expected_mean, expected_std = alone(history).posterior()
    assert mean == pytest.approx(expected_mean, abs=1e-9)
    assert std == pytest.approx(expected_std, abs=1e-9)


@pytest.mark.usefixtures("converged")
def test_without_common_taste_each_person_has_a_model_of_their_own() -> None:
    history = answers(TWO, 12, seed=2, ties=True)
    together = replayed(history, SEPARATE, ONE_SCALE)
    for name in TWO:
        mean, std = together.posterior(name)
        own = alone([entry for entry in history if entry[4] == name])
        expected_mean, expected_std = own.posterior()
        # The common share of 1e-12 is what remains between the two.
        assert mean == pytest.approx(expected_mean, abs=1e-7)
        assert std == pytest.approx(expected_std, abs=1e-7)
        assert together.best(name) == own.best()


def test_with_length_scales_averaged_pooling_finds_the_same_best() -> None:
    history = answers(TWO, 12, seed=3)
    settings = Settings(threshold_length_scales=(0.2, 0.4))
    assert replayed(history, POOLED, settings).best() == alone(history, settings).best()


def test_people_of_one_taste_are_better_known_together_than_alone() -> None:
    f = landscape((0.4, 0.8))
    history = answers({f"p{number}": f for number in range(6)}, 10, seed=4)
    together = replayed(history)
    assert f.max() - f[together.best()] < 0.2
    _, of_person = together.posterior("p0")
    _, of_stranger = together.posterior("somebody new")
    assert of_person.mean() < of_stranger.mean()


def test_a_person_who_differs_keeps_a_best_of_their_own_and_is_not_called_noisy() -> None:
    people = {f"p{number}": landscape((0.2, 0.2)) for number in range(4)}
    people["other"] = landscape((0.8, 0.8))
    together = replayed(answers(people, 25, seed=5))
    own = people["other"]
    assert own.max() - own[together.best("other")] < 0.4
    assert own.max() - own[together.best()] > 1.0
    model = together.people_model()
    assert model.noise[list(model.names).index("other")] < 1.6
    assert model.share_weights[0] < 0.05


def test_random_answers_are_noisy_and_honest_ones_are_not() -> None:
    f = landscape((0.6, 0.4))
    history = answers({f"p{number}": f for number in range(5)}, 25, seed=6)
    rng = np.random.default_rng(6)
    for _ in range(25):
        left, right = (int(row) for row in rng.choice(len(GRID), 2, replace=False))
        history.append((left, right, str(rng.choice(["left", "right"])), None, "spammer"))
    model = replayed(history).people_model()
    noise = dict(zip(model.names, model.noise, strict=True))
    assert noise.pop("spammer") > 2.5
    assert max(noise.values()) < 1.6


def test_always_left_is_an_inclination_to_a_side_and_not_reliable() -> None:
    f = landscape((0.6, 0.4))
    history = answers({f"p{number}": f for number in range(5)}, 20, seed=7)
    rng = np.random.default_rng(7)
    for _ in range(20):
        left, right = (int(row) for row in rng.choice(len(GRID), 2, replace=False))
        history.append((left, right, "left", None, "lefty"))
    model = replayed(history).people_model()
    lefty = list(model.names).index("lefty")
    assert model.noise[lefty] > 1.0
    assert model.noise[lefty] > np.delete(model.noise, lefty).max()


def test_nobody_weighs_more_than_the_stated_cap() -> None:
    settings = PeopleSettings()
    sharp = answers({"p1": 50.0 * TWO["p1"], "p2": TWO["p2"]}, 40, seed=8)
    model = replayed(sharp).people_model()
    assert min(model.noise) >= settings.noises[0]
    assert max(model.noise) <= settings.noises[-1]


def test_who_has_answered_little_is_near_the_average() -> None:
    history = answers(TWO, 15, seed=9)
    model = replayed([*history, (0, 35, "left", None, "p3")]).people_model()
    assert model.noise[2] == pytest.approx(1.0, abs=0.25)


def test_the_order_of_answers_between_two_full_fits_does_not_reach_the_hyperparameters() -> None:
    settings = PeopleSettings()
    assert settings.last_full_fit(5) == 5
    moments = [n for n in range(1, 700) if settings.last_full_fit(n) == n]
    assert moments[: settings.exact_answers] == list(range(1, settings.exact_answers + 1))
    steps = np.array(moments[settings.exact_answers :])
    assert np.all(np.diff(steps) / steps[:-1] <= settings.growth - 1.0 + 1.0 / steps[:-1])
    # Without the last answer: what may come after it begins from one fit.
    later = [n for n in moments if n >= settings.exact_answers]
    unsettled = PeopleSettings(unsettled=1)
    assert [unsettled.last_full_fit(n + 1) for n in later] == later


def test_the_summary_of_older_answers_says_nearly_what_they_say() -> None:
    history = answers({f"p{number}": landscape((0.4, 0.6)) for number in range(5)}, 12, seed=10)
    history = history[:59]
    assert PeopleSettings().last_full_fit(59) < 59
    summarised = replayed(history).posterior()
    exact = replayed(history, PeopleSettings(growth=1.0)).posterior()
    assert np.corrcoef(summarised[0], exact[0])[0, 1] > 0.99
    assert summarised[1] == pytest.approx(exact[1], abs=0.15)


def test_a_step_between_two_full_fits_fits_few_people_again_and_knows_all() -> None:
    """A full fit of 12 answers, and summaries after 20 and 28."""
    f = landscape((0.4, 0.6))
    people = PeopleSettings(growth=4.0)
    history = answers({f"p{number}": f for number in range(12)}, 3, seed=15)[:35]
    assert list(people.summaries(35)) == [20, 28]
    optimizer = replayed(history, people, ONE_SCALE)
    one_by_one = replace(people, summarised_after=100)
    exact = replayed(history, one_by_one, ONE_SCALE)
    again = [int(number) for g in optimizer.people_model().answers.groups for number in g.people]
    assert sorted(again) == [4, 5, 6, 7, 8, 9, 10]
    for person in (None, "p0", "p3", "p11"):
        mean, std = optimizer.posterior(person)
        expected_mean, expected_std = exact.posterior(person)
        assert np.corrcoef(mean, expected_mean)[0, 1] > 0.98
        assert std == pytest.approx(expected_std, abs=0.1)


def test_answers_in_the_summary_are_the_same_answered_live_and_replayed() -> None:
    f = landscape((0.4, 0.6))
    live = PreferenceOptimizer(GRID, "pbpo-threshold", seed=4)
    history: list[Entry] = []
    for step in range(18):
        name = f"p{step % 3}"
        query = live.ask(name)
        response = "left" if f[query.left] > f[query.right] else "right"
        history.append((query.left, query.right, response, None, name))
        live.tell(query, response, person=name)
    again = PreferenceOptimizer.replay(GRID, history, method="pbpo-threshold", seed=4)
    assert again.posterior()[0].tolist() == live.posterior()[0].tolist()
    assert again.ask("p1") == live.ask("p1")
    assert live.people == ("p0", "p1", "p2")


def test_people_who_ask_at_once_get_different_pairs_and_numbers() -> None:
    optimizer = replayed(answers(TWO, 6, seed=11))
    queries = [optimizer.ask(f"q{number}") for number in range(10)]
    assert len({frozenset((query.left, query.right)) for query in queries}) == 10
    assert len({query.index for query in queries}) == 10
    assert optimizer.ask("q3") == queries[3]


def test_a_query_may_be_asked_for_nobody_in_particular() -> None:
    optimizer = PreferenceOptimizer(GRID, "pbpo-threshold", seed=1)
    query = optimizer.ask()
    optimizer.tell(query, "left", person="p1")
    assert optimizer.responses == 1
    another = optimizer.ask()
    assert another != query
    optimizer.tell(another, "skip", "cannot_tell", person="p2")
    assert optimizer.people == ("p1", "p2")


def test_a_query_for_a_person_finds_their_own_best() -> None:
    history = answers(
        {
            **{f"p{number}": landscape((0.2, 0.2)) for number in range(3)},
            "o": landscape((0.8, 0.8)),
        },
        25,
        seed=12,
    )
    optimizer = replayed(history)
    own = optimizer.ask("o", target="person")
    f = landscape((0.8, 0.8))
    assert max(f[own.left], f[own.right]) > -0.8
    with pytest.raises(PersonError, match="expected a person"):
        optimizer.ask(target="person")
    with pytest.raises(PersonError, match="population or person"):
        optimizer.ask("o", target="everybody")


def test_a_person_who_is_forgotten_was_never_there() -> None:
    history = answers({**TWO, "p3": landscape((0.5, 0.5))}, 10, seed=13)
    optimizer = replayed(history)
    optimizer.best()
    waiting = optimizer.ask("p2")
    optimizer.ask("p3")
    optimizer.forget("p3")
    without = replayed([entry for entry in history if entry[4] != "p3"])
    assert optimizer.posterior()[0].tolist() == without.posterior()[0].tolist()
    assert optimizer.people == ("p1", "p2")
    assert optimizer.ask("p2") == waiting
    with pytest.raises(PersonError, match="expected one of p1, p2"):
        optimizer.forget("p3")


def test_sureness_is_the_populations() -> None:
    f = landscape((0.4, 0.6))
    few = replayed(answers({"p1": f, "p2": f}, 3, seed=14))
    many = replayed(answers({"p1": f, "p2": f}, 25, seed=14))
    assert few.sureness(0.2) < many.sureness(0.2)


def test_names_are_all_or_none() -> None:
    optimizer = PreferenceOptimizer(GRID, "pbpo-threshold")
    optimizer.tell(optimizer.ask(), "left")
    with pytest.raises(PersonError, match="1 earlier responses name none"):
        optimizer.tell(optimizer.ask(), "left", person="p1")
    named = PreferenceOptimizer(GRID, "pbpo-threshold")
    named.tell(named.ask(), "left", person="p1")
    with pytest.raises(PersonError, match="expected a name"):
        named.tell(named.ask("p1"), "left")
    with pytest.raises(HistoryError, match="expected a person"):
        replayed([(0, 1, "left", None, "p1"), (0, 1, "left", None)])  # type: ignore[list-item]


def test_a_person_cannot_answer_another_ones_query() -> None:
    optimizer = PreferenceOptimizer(GRID, "pbpo-threshold")
    query = optimizer.ask("p1")
    with pytest.raises(QueryNotAskedError, match="p2"):
        optimizer.tell(query, "left", person="p2")


@pytest.mark.parametrize("method", ["pbpo", "knockout"])
def test_other_methods_know_one_person(method: str) -> None:
    with pytest.raises(PersonError, match="pbpo-threshold"):
        PreferenceOptimizer(GRID, method).ask("p1")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"own_shares": (0.5, 1.5)}, "own_shares: expected a share from 0 to 1, got 1.5"),
        ({"own_shares": ()}, "own_shares: expected one number at least"),
        ({"noises": (2.0, 1.0)}, "noises: expected rising numbers"),
        ({"noise_prior": (1.0,)}, "noise_prior: expected a number above 0 for each of 6"),
        ({"side_variance": -1.0}, "side_variance: expected a number from 0 on"),
        ({"growth": 0.5}, "growth: expected a factor from 1 on"),
        ({"summarised_after": 0}, "summarised_after: expected a whole number from 1 on"),
        ({"exact_answers": 1.5}, "exact_answers: expected a whole number"),
        ({"own_thresholds": "all"}, "own_thresholds: expected a finite number, got 'all'"),
    ],
)
def test_settings_that_cannot_be_are_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        PeopleSettings(**given)  # type: ignore[arg-type]


SQUARE = Box(low=[0.0, 0.0], high=[1.0, 1.0])


BoxEntry = tuple[FloatArray, FloatArray, str, str | None, str]


def in_the_box(optimizer: BoxOptimizer, people: int, steps: int) -> list[BoxEntry]:
    """People of one taste answer in turn; what they answered."""
    best = np.array([0.3, 0.7])
    history: list[BoxEntry] = []
    for step in range(steps):
        name = f"p{step % people}"
        query = optimizer.ask(name)
        near = ((query.left - best) ** 2).sum() < ((query.right - best) ** 2).sum()
        response = "left" if near else "right"
        history.append((query.left, query.right, response, None, name))
        optimizer.tell(query, response, person=name)
    return history


def test_several_people_search_a_box_together() -> None:
    optimizer = BoxOptimizer(SQUARE, seed=2)
    history = in_the_box(optimizer, 3, 18)
    assert np.linalg.norm(optimizer.best() - np.array([0.3, 0.7])) < 0.2
    assert np.linalg.norm(optimizer.best("p1") - np.array([0.3, 0.7])) < 0.3
    again = BoxOptimizer.replay(SQUARE, history, seed=2)
    assert again.best().tolist() == optimizer.best().tolist()
    mean, std = optimizer.posterior([[0.3, 0.7], [0.9, 0.1]], "p2")
    assert mean[0] > mean[1]
    assert std.min() > 0.0
    assert 0.0 <= optimizer.sureness(0.3) <= 1.0


def test_in_a_box_an_unsafe_point_lies_below_everybodys_threshold() -> None:
    optimizer = BoxOptimizer(SQUARE, seed=2)
    in_the_box(optimizer, 2, 10)
    before, _ = optimizer.posterior([[0.3, 0.7]])
    open_query = optimizer.ask("p1")
    optimizer.exclude(open_query.left)
    assert not np.array_equal(optimizer.ask("p1").left, open_query.left)
    optimizer.exclude([0.3, 0.7])
    after, _ = optimizer.posterior([[0.3, 0.7]])
    assert after[0] < before[0]


@pytest.mark.usefixtures("converged")
def test_in_a_box_pooling_is_one_person_who_gave_all_answers() -> None:
    optimizer = BoxOptimizer(SQUARE, seed=2, settings=ONE_SCALE, people=POOLED)
    history = in_the_box(optimizer, 2, 14)
    one = BoxOptimizer.replay(
        SQUARE, [(*entry[:3], entry[3]) for entry in history], seed=2, settings=ONE_SCALE
    )
    at = [[0.1, 0.2], [0.3, 0.7], [0.8, 0.8]]
    for mine, theirs in zip(optimizer.posterior(at), one.posterior(at), strict=True):
        assert mine == pytest.approx(theirs, abs=1e-8)
