"""Questionnaires: what an item may say, and what counts as an answer."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from app.study import Answered, Item, Plan, Progress, Responded, Stage, advance, read_answers

NOON = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
EFFORT = {"name": "effort", "type": "likert", "label": "How hard was it?", "points": 7}
AGE = {"name": "age", "type": "number", "label": "Age?", "min": 18, "max": 120, "required": False}
WORDS = {"name": "remarks", "type": "text", "label": "Anything else?", "required": False}
ITEMS = tuple(Item.model_validate(item) for item in (EFFORT, AGE, WORDS))


@pytest.mark.parametrize(
    ("given", "stored"),
    [
        ({"effort": 4}, ("4", None, None)),
        ({"effort": "7", "age": " 30 ", "remarks": " fine "}, ("7", "30", "fine")),
        ({"effort": 1.0, "age": "30,5", "remarks": "=1+1"}, ("1", "30.5", "=1+1")),
        ({"effort": "2", "age": "", "remarks": None}, ("2", None, None)),
    ],
)
def test_sound_answers_are_stored_as_text(
    given: dict[str, object], stored: tuple[str | None, ...]
) -> None:
    values, faults = read_answers(ITEMS, given)
    assert faults == []
    assert tuple(values[name] for name in ("effort", "age", "remarks")) == stored


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({}, ("effort", "missing", "expected an answer, got none")),
        ({"effort": " "}, ("effort", "missing", "expected an answer, got none")),
        ({"effort": 0}, ("effort", "likert", "expected a whole number from 1 to 7, got 0")),
        ({"effort": "8"}, ("effort", "likert", "expected a whole number from 1 to 7, got '8'")),
        ({"effort": 2.5}, ("effort", "likert", "expected a whole number from 1 to 7, got 2.5")),
        ({"effort": True}, ("effort", "likert", "expected a whole number from 1 to 7, got True")),
        (
            {"effort": 1, "age": "old"},
            ("age", "number", "expected a number from 18 to 120, got 'old'"),
        ),
        ({"effort": 1, "age": 17}, ("age", "number", "expected a number from 18 to 120, got 17")),
        (
            {"effort": 1, "age": "nan"},
            ("age", "number", "expected a number from 18 to 120, got 'nan'"),
        ),
        (
            {"effort": 1, "remarks": 3},
            ("remarks", "text", "expected a text of up to 2000 characters, got 3"),
        ),
        (
            {"effort": 1, "agee": 3},
            ("agee", "unknown", "expected an answer to an item asked here, got 'agee'"),
        ),
    ],
)
def test_what_is_no_answer_is_named(given: dict[str, object], fault: tuple[str, ...]) -> None:
    _, faults = read_answers(ITEMS, given)
    assert [(found.item, found.kind, found.message) for found in faults] == [fault]


def test_a_text_that_is_too_long_is_named_and_all_faults_come_at_once() -> None:
    _, faults = read_answers(ITEMS, {"age": -1, "remarks": "x" * 2001})
    assert [fault.item for fault in faults] == ["effort", "age", "remarks"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "points: 7",
            "points: 1",
            "questionnaires.end[0].points: expected a whole number of points from 2 to 11, got 1",
        ),
        (
            "type: likert",
            "type: scale",
            "questionnaires.end[0].type: expected likert, number, text or choice, got 'scale'",
        ),
        (
            "type: likert",
            "type: text",
            (
                "questionnaires.end[0].points: expected points for type likert only,"
                " got it for type text"
            ),
        ),
        (
            "labels: [Easy, Hard]",
            "labels: [Easy, So, Hard]",
            "questionnaires.end[0].labels: expected 2 labels, for the ends, or 7, got 3",
        ),
        (
            "name: age",
            "name: effort",
            "questionnaires.end[1].name: expected each once, got 'effort' again (as at end[0])",
        ),
        ("max: 9", "max: 0", "questionnaires.end[1].max: expected at least min (1), got 0"),
        (
            "label: 'How hard?'",
            "label: {de: 'Wie schwer?'}",
            "questionnaires.end[0].label: expected a text in every language, got none in en",
        ),
        (
            "name: age",
            "nome: age",
            (
                "questionnaires.end[1].nome: unknown key, expected one of name, type, label,"
                " required, points, labels, choices, min, max (did you mean name?)"
            ),
        ),
    ],
)
def test_a_fault_in_an_item_is_named_with_its_place(
    folder: Path,
    faults: Callable[[Path], list[str]],
    old: str,
    new: str,
    expected: str,
) -> None:
    asked = (
        "questionnaires:\n  end:\n"
        "    - {name: effort, type: likert, points: 7, label: 'How hard?', labels: [Easy, Hard]}\n"
        "    - {name: age, type: number, min: 1, max: 9, label: 'How old?'}\n"
    )
    with (folder / "study.yaml").open("a", encoding="utf-8") as file:
        file.write(asked.replace(old, new))
    assert any(fault.endswith(expected) for fault in faults(folder)), faults(folder)


def test_questions_come_after_each_trial_and_once_more_at_the_end(
    build_plan: Callable[..., Plan],
) -> None:
    plan = build_plan(
        queries_per_trial=1,
        break_s=60,
        questionnaires={"after_trial": [EFFORT], "end": [AGE]},
    )
    asked = advance(plan, Progress(Stage.QUERY), Responded(0, NOON))
    assert asked == Progress(Stage.QUESTIONNAIRE, trial_index=1)
    # The break is counted from the end of the questions, which are no rest.
    later = NOON + timedelta(seconds=30)
    rest = advance(plan, asked, Answered(later))
    assert (rest.stage, rest.break_ends_at) == (Stage.BREAK, later + timedelta(seconds=60))

    last = advance(plan, Progress(Stage.QUERY, trial_index=1), Responded(0, NOON))
    assert last == Progress(Stage.QUESTIONNAIRE, trial_index=2)
    end = advance(plan, last, Answered(NOON))
    assert end == Progress(Stage.QUESTIONNAIRE, trial_index=2, query_index=1)
    assert advance(plan, end, Answered(NOON)) == Progress(Stage.DEBRIEF, trial_index=2)


@pytest.mark.parametrize(
    ("text", "stored"),
    [
        ("\r\n".join(["x"] * 1000) + "y", "\n".join(["x"] * 1000) + "y"),
        ("a\rb\r\nc", "a\nb\nc"),
        ("\U0001f600" * 1000, "\U0001f600" * 1000),
        ("水" * 2000, "水" * 2000),
    ],
)
def test_a_text_that_its_field_takes_is_stored_with_the_line_breaks_of_the_field(
    text: str, stored: str
) -> None:
    values, faults = read_answers(ITEMS, {"effort": 1, "remarks": text})
    assert faults == []
    assert values["remarks"] == stored


@pytest.mark.parametrize("text", ["\U0001f600" * 1000 + "y", "\r\n".join(["x"] * 1001)])
def test_a_text_that_its_field_does_not_take_is_too_long(text: str) -> None:
    _, faults = read_answers(ITEMS, {"effort": 1, "remarks": text})
    assert [(fault.item, fault.kind) for fault in faults] == [("remarks", "text")]


HAND = Item.model_validate(
    {"name": "hand", "type": "choice", "label": "Hand?", "choices": {"left": "L", "right": "R"}}
)


def test_one_of_the_choices_is_an_answer_and_is_stored_by_its_name() -> None:
    assert read_answers([HAND], {"hand": "right"}) == ({"hand": "right"}, [])
    for other in ("R", 1, "both"):
        _, (fault,) = read_answers([HAND], {"hand": other})
        assert (fault.kind, fault.message) == (
            "choice",
            f"expected one of left, right, got {other!r}",
        )
