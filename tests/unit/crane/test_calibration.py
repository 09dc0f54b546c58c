"""The simulated world beside the published one, the cost of the library, and the search."""

import time
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from app.crane import calibration as calibration_module
from app.crane import library
from app.crane.calibration import calibration, compare, main, table
from app.crane.environments import ENVIRONMENTS, FloatArray, candidates
from app.crane.landscape import PUBLISHED, Landscape, landscape
from app.crane.search import RANGES, Range, best_weight, build, fit, misfit, simulate_scores

WHOLE_LIBRARY_SECONDS = 10.0


def met(name: str) -> Landscape:
    """A landscape that agrees with every published figure of ``name``."""
    published = PUBLISHED[name]
    return Landscape(
        best_candidate=published.best_candidate,
        best=published.best,
        mean=published.mean,
        deviation=published.deviation,
        spread=15.0 if name == "env1" else 10.0,
        fifth_best=-60.0,
        high=30,
        middling=10,
    )


def missed(env1: Landscape, env2: Landscape) -> list[tuple[str, str]]:
    return [(c.environment, c.figure) for c in compare(env1, env2) if not c.holds]


def test_the_simulated_world_meets_every_published_figure() -> None:
    checks = calibration()
    assert all(check.holds for check in checks), "\n" + table(checks)


def test_the_whole_library_takes_seconds_and_gives_the_same_bytes_again() -> None:
    kept = {name: library.series(name) for name in ENVIRONMENTS}
    # Processor time, so that a busy machine does not decide.
    began = time.process_time()
    for name, series in kept.items():
        assert series.shape == (231, library.RUNS_PER_CANDIDATE, 501)
        for index in range(len(candidates())):
            for k in range(library.RUNS_PER_CANDIDATE):
                again = library.run(name, index, k).weight
                assert again.tobytes() == series[index, k].tobytes()
    assert time.process_time() - began < WHOLE_LIBRARY_SECONDS


def numbers_in(value: object) -> list[object]:
    if is_dataclass(value):
        return [leaf for f in fields(value) for leaf in numbers_in(getattr(value, f.name))]
    return [value]


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_an_environment_is_nothing_but_numbers_so_none_can_depend_on_the_candidate(
    name: str,
) -> None:
    leaves = numbers_in(ENVIRONMENTS[name])
    assert leaves[0] == name
    assert all(isinstance(leaf, int | float) for leaf in leaves[1:])


def test_a_landscape_sums_up_scores_whose_figures_are_known() -> None:
    scores = np.full((231, 2), -100.0)
    scores[40] = [-30.0, -50.0]
    scores[50:54] = [-44.0, -46.0]
    ours = landscape(scores)
    assert ours.best_candidate == tuple(candidates()[40])
    assert ours.best == -40.0
    assert ours.fifth_best == -45.0
    assert ours.high == 1
    assert ours.middling == 5
    assert ours.mean == pytest.approx((226 * -100.0 - 40.0 - 4 * 45.0) / 231)
    assert ours.spread == pytest.approx((10.0 + 4 * 1.0) / 231)
    assert ours.deviation == pytest.approx(scores.std())


def test_the_published_world_itself_holds_in_every_row() -> None:
    assert missed(met("env1"), met("env2")) == []


@pytest.mark.parametrize(
    ("change", "row"),
    [
        ({"mean": -71.8}, "mean of g"),
        ({"deviation": 26.5}, "standard deviation of g"),
        ({"best": -31.6}, "f(w*)"),
        ({"best_candidate": (0.8, 0.6)}, "w*"),
        ({"best_candidate": (0.95, 0.75)}, "w*"),
        ({"high": 11}, "candidates with f above -45"),
    ],
)
def test_a_figure_of_env1_outside_its_tolerance_is_the_one_row_that_does_not_hold(
    change: dict[str, object], row: str
) -> None:
    shifted = replace(met("env1"), **change)  # type: ignore[arg-type]
    assert missed(shifted, met("env2")) == [("env1", row)]


@pytest.mark.parametrize(
    ("change", "row"),
    [
        ({"fifth_best": -75.5}, "fifth best f"),
        ({"middling": 21}, "candidates with f above -95"),
    ],
)
def test_a_peak_of_env2_that_is_too_narrow_or_too_broad_does_not_hold(
    change: dict[str, object], row: str
) -> None:
    shifted = replace(met("env2"), **change)  # type: ignore[arg-type]
    assert missed(met("env1"), shifted) == [("env2", row)]


def test_an_optimum_exactly_two_steps_away_still_holds() -> None:
    assert missed(replace(met("env1"), best_candidate=(0.85, 0.7)), met("env2")) == []


def test_env2_spreading_more_than_env1_does_not_hold() -> None:
    wide = replace(met("env2"), spread=15.1)
    assert missed(met("env1"), wide) == [("both", "run-to-run spread of g")]


def test_the_command_prints_the_table_and_succeeds(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[0].split()[:4] == [
        "environment",
        "figure",
        "published",
        "simulated",
    ]
    assert "(0.95, 0.60)" in printed
    assert "-125.7" in printed


def test_the_command_fails_and_says_no_when_a_figure_is_missed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def shifted(name: str) -> FloatArray:
        return library.scores(name) - 5.0

    monkeypatch.setattr(
        calibration_module, "calibration", lambda: compare(*map(landscape, map(shifted, RANGES)))
    )
    assert main([]) == 1
    assert "NO" in capsys.readouterr().out


def test_twice_the_weight_and_flow_double_every_score() -> None:
    for name, ranges in RANGES.items():
        point = np.full(len(ranges), 0.4)
        single = simulate_scores(build(name, point, 1.0), runs=1)
        double = simulate_scores(build(name, point, 2.0), runs=1)
        np.testing.assert_allclose(double, 2.0 * single, rtol=1e-9)


def test_the_grasped_weight_follows_from_figures_that_fit_up_to_a_factor() -> None:
    ours = met("env1")
    tenth = replace(ours, mean=ours.mean / 10, deviation=ours.deviation / 10, best=ours.best / 10)
    assert best_weight(tenth, PUBLISHED["env1"]) == pytest.approx(10.0)


def test_the_shipped_constants_misfit_less_than_an_arbitrary_point_of_the_search() -> None:
    for name, ranges in RANGES.items():
        point = np.full(len(ranges), 0.5)
        arbitrary = simulate_scores(build(name, point, ENVIRONMENTS[name].grasp.weight))
        assert misfit(library.scores(name), name) < 3.0 < misfit(arbitrary, name)


def test_a_logarithmic_range_reaches_its_ends_and_its_geometric_middle() -> None:
    span = Range(0.1, 10.0, logarithmic=True)
    assert [span.at(0.0), span.at(0.5), span.at(1.0)] == pytest.approx([0.1, 1.0, 10.0])


def test_a_search_with_the_same_seed_goes_the_same_way_and_never_loses_its_best() -> None:
    told: list[str] = []
    retold: list[str] = []
    first = fit("env2", seed=3, draws=2, steps=3, report=told.append)
    again = fit("env2", seed=3, draws=2, steps=3, report=retold.append)
    assert first == again
    assert told == retold
    began, ended = (float(line.rsplit(" ", 1)[1]) for line in told)
    assert ended <= began


def test_a_range_tells_where_a_value_lies_between_its_ends() -> None:
    for span in (Range(2.0, 6.0), Range(0.1, 10.0, logarithmic=True)):
        assert span.at(span.share(3.0)) == pytest.approx(3.0)
