"""Which preferences a skip becomes, and from which earlier choice."""

from collections import Counter

from app.pbbo import Preference, Response
from app.pbbo.skip_synthesis import Learned


def learned(
    *responses: tuple[int, int, Response], seed: int = 0, synthesise: bool = True
) -> Learned:
    log = Learned(seed=seed, synthesise=synthesise)
    for index, (left, right, response) in enumerate(responses):
        log.record(index, left, right, response)
    return log


def test_an_answer_becomes_one_preference() -> None:
    log = learned((3, 4, "left"), (5, 6, "right"))

    assert log.preferences == (Preference(3, 4, "answer", 0), Preference(6, 5, "answer", 1))


def test_a_skip_puts_an_earlier_choice_above_both() -> None:
    log = learned((3, 4, "right"), (5, 6, "skip"))

    assert log.preferences[1:] == (
        Preference(4, 5, "synthesis", 1, drawn_from_query_index=0),
        Preference(4, 6, "synthesis", 1, drawn_from_query_index=0),
    )


def test_skips_before_any_choice_wait_for_the_first_one() -> None:
    waiting = learned((1, 2, "skip"), (3, 4, "skip"))
    assert len(waiting.preferences) == 0

    waiting.record(2, 5, 6, "left")

    assert list(waiting.preferences) == [
        Preference(5, 6, "answer", 2),
        Preference(5, 1, "synthesis", 0, drawn_from_query_index=2),
        Preference(5, 2, "synthesis", 0, drawn_from_query_index=2),
        Preference(5, 3, "synthesis", 1, drawn_from_query_index=2),
        Preference(5, 4, "synthesis", 1, drawn_from_query_index=2),
    ]


def test_a_candidate_is_never_preferred_over_itself() -> None:
    log = learned((1, 2, "left"), (1, 3, "skip"))
    assert [p.origin for p in log.preferences] == ["answer"]

    log.record(2, 4, 5, "right")

    assert log.preferences[2:] == (
        Preference(5, 1, "synthesis", 1, drawn_from_query_index=2),
        Preference(5, 3, "synthesis", 1, drawn_from_query_index=2),
    )


def test_the_choice_is_drawn_uniformly_over_the_answers_so_far() -> None:
    drawn: Counter[int | None] = Counter()
    for seed in range(600):
        log = learned((0, 1, "left"), (2, 3, "left"), (0, 4, "left"), (7, 8, "skip"), seed=seed)
        drawn[log.preferences[-1].drawn_from_query_index] += 1

    assert set(drawn) == {0, 1, 2}
    assert all(150 < count < 250 for count in drawn.values())


def test_both_preferences_of_a_skip_have_the_same_winner() -> None:
    for seed in range(20):
        log = learned((0, 1, "left"), (2, 3, "left"), (7, 8, "skip"), seed=seed)
        assert log.preferences[-1].winner == log.preferences[-2].winner


def test_without_synthesis_a_skip_teaches_nothing() -> None:
    log = learned((0, 1, "left"), (2, 3, "skip"), synthesise=False)

    assert log.preferences == (Preference(0, 1, "answer", 0),)
    assert log.answers == 1
