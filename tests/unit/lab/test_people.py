"""The simulated evaluators who stand in for people."""

from __future__ import annotations

import numpy as np
import pytest

from app.lab.people import PEOPLE, Person, SkipReason, TraitError, Traits

AVERAGE = Traits(skip_level=0.0, eta=0.08, equal_within=5.0)


def person(traits: Traits = AVERAGE, reason: SkipReason = "undesirable", seed: int = 0) -> Person:
    return Person(traits, reason, mean=-70.0, deviation=20.0, rng=np.random.default_rng(seed))


def test_where_a_skip_means_undesirable_it_takes_two_bad_runs() -> None:
    assert person().respond(-71.0, -90.0, may_skip=True) == "skip"
    assert person().respond(-69.0, -90.0, may_skip=True) != "skip"


def test_where_a_skip_means_hard_to_choose_it_takes_two_equal_runs_good_or_bad() -> None:
    assert person(reason="equal").respond(-30.0, -33.0, may_skip=True) == "skip"
    assert person(reason="equal").respond(-130.0, -133.0, may_skip=True) == "skip"
    assert person(reason="equal").respond(-130.0, -100.0, may_skip=True) != "skip"


def test_nobody_skips_where_there_is_no_button() -> None:
    for reason in ("undesirable", "equal"):
        one = person(reason=reason)
        answers = {one.respond(-130.0, -131.0, may_skip=False) for _ in range(50)}
        assert answers == {"left", "right"}


def test_a_level_of_ones_own_shifts_the_skip_by_deviations_of_g() -> None:
    demanding = person(Traits(skip_level=1.0, eta=0.08, equal_within=5.0))
    assert demanding.respond(-51.0, -60.0, may_skip=True) == "skip"
    assert demanding.respond(-49.0, -60.0, may_skip=True) != "skip"


def test_the_better_run_is_chosen_as_often_as_bradley_and_terry_say() -> None:
    one = person()
    lefts = sum(one.respond(-40.0, -50.0, may_skip=True) == "left" for _ in range(4000))
    expected = 1.0 / (1.0 + np.exp(-0.08 * 10.0))
    assert abs(lefts / 4000 - expected) < 4 * np.sqrt(expected * (1 - expected) / 4000)


def test_the_five_differ_and_their_levels_rise_from_reluctant_to_ready() -> None:
    levels = [traits.skip_level for traits in PEOPLE]
    assert levels == sorted(levels)
    assert len(set(levels)) == len({t.eta for t in PEOPLE}) == len(PEOPLE) == 5
    assert np.mean(levels) == pytest.approx(0.0)


def test_the_consistency_of_the_five_is_that_of_the_paper_on_the_geometric_mean() -> None:
    assert np.exp(np.mean(np.log([t.eta for t in PEOPLE]))) == pytest.approx(0.08)


@pytest.mark.parametrize(
    ("skip_level", "eta", "equal_within", "named"),
    [(float("nan"), 0.08, 5.0, "skip_level"), (0.0, 0.0, 5.0, "eta"), (0.0, 1.0, -1.0, "equal")],
)
def test_a_trait_that_nobody_can_have_is_named(
    skip_level: float, eta: float, equal_within: float, named: str
) -> None:
    with pytest.raises(TraitError, match=named):
        Traits(skip_level, eta, equal_within)
