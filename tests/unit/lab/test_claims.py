"""Verdicts on results whose outcome was chosen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from app.lab import claims_people, claims_simulated
from app.lab.claims import Claim
from app.lab.environments import World
from app.lab.experiments import Task
from app.lab.results import MissingResultsError, Results
from app.statistics.comparisons import p_value

Rank = Callable[[Task], int]
Make = Callable[[Rank], Results]


def as_the_paper(task: Task) -> int:
    """PBPO close to the best, the others behind it where the paper finds them so."""
    near = task.trial % 3
    if task.experiment == "scores":
        return 0 if task.method == "rbo" else 20 + near
    if task.method == "pbpo" or (task.experiment == "certain" and task.method == "pbpo-no-skip"):
        return near
    if task.experiment == "people" and task.environment == "env1":
        return near
    return 60 + 20 * (task.trial % 4)


def all_alike(task: Task) -> int:
    return task.trial % 3


def by_name(claims: list[Claim]) -> dict[str, bool]:
    found = {claim.name: claim.holds for claim in claims}
    assert len(found) == len(claims), "every claim has a name of its own"
    return found


def test_results_like_the_papers_hold_its_claims_about_simulated_evaluators(
    make_results: Make,
) -> None:
    results = make_results(as_the_paper)
    for figure in (10, 12):
        assert all(by_name(list(claims_simulated.of_curves(results, figure))).values())
    certain = by_name(list(claims_simulated.of_violins(results, 11)))
    # The chosen medians are those of the second best candidate, not of the best.
    assert {name for name, holds in certain.items() if not holds} == {
        "fig11-env2-median-60",
        "fig11-env2-median-80",
    }
    assert all(by_name(list(claims_simulated.of_violins(results, 13))).values())


def test_methods_that_come_out_alike_hold_only_claims_of_no_difference(make_results: Make) -> None:
    results = make_results(all_alike)
    certain = by_name(list(claims_simulated.of_violins(results, 11)))
    assert {name for name, holds in certain.items() if holds} == {
        f"fig11-{environment}-pbpo-no-skip-{queries}"
        for environment in ("env1", "env2")
        for queries in (40, 60, 80)
    }
    for figure in (10, 12):
        assert not any(by_name(list(claims_simulated.of_curves(results, figure))).values())


def test_a_significant_difference_the_wrong_way_round_does_not_hold(make_results: Make) -> None:
    results = make_results(lambda task: 90 + task.trial if task.method == "pbpo" else 0)
    tests = by_name(list(claims_simulated.of_violins(results, 13)))
    assert not any(tests.values())


def test_the_ablation_holds_where_only_env2_tells_the_methods_apart(make_results: Make) -> None:
    assert all(by_name(list(claims_people.of_ablation(make_results(as_the_paper)))).values())
    alike = by_name(list(claims_people.of_ablation(make_results(all_alike))))
    assert {name.split("-")[1] for name, holds in alike.items() if holds} == {"env1"}


def test_rbo_at_the_optimum_in_every_trial_is_seen(make_results: Make) -> None:
    results = make_results(as_the_paper)
    acquired = {claim.name: claim for claim in claims_people.of_acquired(results)}
    assert acquired["fig19-env2-rbo"].holds
    assert "RBO 6 of 6" in acquired["fig19-env2-rbo"].ours
    assert not acquired["fig19-env1-none"].holds
    boxes = by_name(list(claims_people.of_boxes(results)))
    assert boxes["fig18-env2-rbo"]
    assert boxes["fig18-env1-means"]
    assert not boxes["fig18-env1-bo"]
    assert boxes["fig18-env2-maximum"]


def test_skips_are_counted_per_evaluator(make_results: Make) -> None:
    claims = list(claims_people.of_skips(make_results(all_alike)))
    assert [claim.ours[:8] for claim in claims] == ["10 to 10", "10 to 10"]
    assert not any(claim.holds for claim in claims)


def test_the_rank_of_the_good_region_is_one_for_f_itself_and_zero_for_its_opposite(
    world: World,
) -> None:
    top = claims_people.good_rank(world, world.f)
    # A little less where candidates tie.
    assert top == pytest.approx(1 - (claims_people.GOOD_CANDIDATES - 1) / 2 / 230, abs=0.002)
    assert claims_people.good_rank(world, -world.f) == pytest.approx(1 - top, abs=0.002)
    by_chance = claims_people.good_rank(world, np.random.default_rng(0).normal(size=231))
    assert 0.35 < by_chance < 0.65


def test_a_peak_at_another_place_and_height_does_not_hold(make_results: Make) -> None:
    worlds = by_name(list(claims_simulated.of_the_worlds(make_results(all_alike))))
    assert not worlds["fig9-env1-optimum"]
    assert not worlds["fig9-env2-f(w*)"]


@pytest.mark.parametrize(
    ("p", "text"), [(0.2, "= .200"), (0.0123, "= .012"), (0.00042, "= .0004"), (1e-9, "< .0001")]
)
def test_p_values_are_printed_as_usual(p: float, text: str) -> None:
    assert p_value(p) == text


def test_results_that_were_not_run_are_named(make_results: Make) -> None:
    results = make_results(all_alike)
    with pytest.raises(MissingResultsError, match="trials of magic in env1"):
        results.trials("certain", "env1", "magic")
    with pytest.raises(MissingResultsError, match="expected 400 crane runs, got 160"):
        results.after_queries("certain", "env1", "pbpo", 200)
