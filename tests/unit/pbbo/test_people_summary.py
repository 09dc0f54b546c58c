"""What several people's answers say, in numbers to read."""

from __future__ import annotations

import numpy as np
import pytest

from app.pbbo import Box, PeopleSettings, PersonError, Settings
from app.pbbo.candidates import Candidates, FloatArray
from app.pbbo.people_answers import PersonAnswer
from app.pbbo.people_belief import belief_of, fitter_over
from app.pbbo.people_summary import PeopleSummary, summarise_box, summarise_candidates
from app.pbbo.people_taste import kinds_of

AXIS = np.linspace(0.0, 1.0, 6)
GRID = np.array([(a, b) for a in AXIS for b in AXIS])
#: One length scale: a fit is then quick.
SETTINGS = Settings(threshold_length_scales=(0.3,))


def landscape(best: tuple[float, float]) -> FloatArray:
    return np.asarray(-4.0 * ((GRID - np.array(best)) ** 2).sum(axis=1))


def answers(people: dict[str, FloatArray | None], each: int) -> list[PersonAnswer]:
    """What people answer to random pairs; None for a person who chooses by chance."""
    rng = np.random.default_rng(3)
    history = []
    for _ in range(each):
        for name, f in people.items():
            left, right = (int(row) for row in rng.choice(len(GRID), 2, replace=False))
            if f is not None and max(f[left], f[right]) < -2.5:
                history.append(PersonAnswer(name, left, right, "skip", "both_bad"))
                continue
            better = 0.0 if f is None else float(f[left] - f[right])
            is_left = better + 0.4 * rng.standard_normal() > 0.0
            history.append(
                PersonAnswer(name, left, right, "left" if is_left else "right", "both_bad")
            )
    return history


def summary_of(people: dict[str, FloatArray | None], each: int) -> PeopleSummary:
    return summarise_candidates(GRID, answers(people, each), SETTINGS)


def test_who_differs_is_not_noisy_and_who_answers_by_chance_is() -> None:
    common = landscape((0.2, 0.2))
    people: dict[str, FloatArray | None] = {f"p{number}": common for number in range(4)}
    found = summary_of(people | {"other": landscape((0.8, 0.8)), "chance": None}, 24)
    by_name = {person.name: person for person in found.people}
    assert np.linalg.norm(GRID[found.best] - 0.2) < 0.3
    other, chance = by_name["other"], by_name["chance"]
    assert other.costs > 0.3
    assert other.likeness < 0.5
    assert other.noisy < 0.3
    assert np.linalg.norm(GRID[other.best] - 0.8) < 0.3
    assert chance.noisy > 0.5
    assert chance.noise.value > 1.5 * other.noise.value
    assert chance.influence < other.influence
    assert all(by_name[f"p{number}"].costs < 0.2 for number in range(4))
    assert found.own_share.low > 0.0
    assert found.disagreement[found.best] > 0.0
    for one in found.where:
        assert one.low <= one.value <= one.high
    assert found.best_probability.sum() == pytest.approx(1.0)
    # The skips placed the threshold below what is good.
    assert by_name["p0"].accepted is not None
    assert 0 < by_name["p0"].accepted < len(GRID)


def test_influence_is_that_of_the_fit_without_the_person() -> None:
    common = landscape((0.4, 0.6))
    history = answers({"p1": common, "p2": common, "p3": landscape((0.9, 0.1))}, 14)
    fixed = PeopleSettings(own_shares=(0.25,), noises=(1.0,), noise_prior=(1.0,), growth=1.0)
    found = summarise_candidates(GRID, history, SETTINGS, fixed)
    candidates = Candidates.from_array(GRID, scale=True)
    for person in found.people:
        rest = [answer for answer in history if answer.person != person.name]
        model = fitter_over(candidates, SETTINGS, fixed).full_fit(rest)
        mean = belief_of(candidates, model, None, SETTINGS).mean
        exact = np.sqrt(np.mean((found.mean - mean) ** 2)) / np.std(found.mean)
        assert person.influence == pytest.approx(exact, rel=0.35)
    assert found.people[2].influence == max(person.influence for person in found.people)


def test_two_kinds_of_taste_are_told_apart_and_one_that_varies_is_not() -> None:
    first, second = landscape((0.1, 0.2)), landscape((0.9, 0.8))
    people = {"a": first, "b": first, "c": second, "d": second, "e": second}
    found = summary_of(dict(people), 24)
    assert found.kinds.number == 2
    assert [person.kind for person in found.people] == [1, 1, 0, 0, 0]
    assert found.people[0].nearest == 1
    drift = np.array([[1.0, 0.8, 0.6], [0.8, 1.0, 0.8], [0.6, 0.8, 1.0]])
    assert kinds_of(np.kron(drift, np.ones((2, 2))), own=1.0).number == 1
    apart = np.kron(np.eye(2), np.ones((2, 2))).astype(np.float64)
    assert kinds_of(apart, own=0.5).number == 1
    assert kinds_of(apart, own=1.0).of == (0, 0, 1, 1)


def test_in_a_box_the_summary_is_about_the_points_shown_and_the_whole_box() -> None:
    box = Box(low=[0.0, 0.0], high=[1.0, 2.0], step=[0.1, 0.2])
    shown = GRID * np.array([1.0, 2.0])
    history = answers({"p1": landscape((0.2, 0.6)), "p2": landscape((0.2, 0.6))}, 12)
    found = summarise_box(box, shown, history, SETTINGS, excluded=(0,))
    assert found.points[: len(shown)].tolist() == shown.tolist()
    assert len(found.points) > len(shown)
    assert bool(box.contains(found.points).all())
    assert np.linalg.norm(found.points[found.best] - np.array([0.2, 1.2])) < 0.5
    assert found.best_probability[0] == 0.0


def test_one_person_is_no_population() -> None:
    with pytest.raises(PersonError, match="expected answers of two people at least, got 1"):
        summary_of({"alone": landscape((0.5, 0.5))}, 3)
