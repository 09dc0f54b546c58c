"""The form and the file are one thing: what is set here stands there, and the rest stays."""

from __future__ import annotations

import difflib

import pytest

from app.study.draft_plan import begin_plan
from app.study.parsed_plan import as_list, as_mapping
from app.study.plan_form import fields, written
from app.study.plan_source import read_plan
from app.study.scaffold import EXAMPLE, MACHINE_EXAMPLE
from app.study.yaml_edit import UneditableError
from app.study.yaml_source import read_yaml

MACHINE_TEXT = (MACHINE_EXAMPLE / "study.yaml").read_text(encoding="utf-8")
TEXT = (EXAMPLE / "study.yaml").read_text(encoding="utf-8")


def sent(text: str = TEXT, **changes: str) -> str:
    """The file after the form was sent with these changes; `_` in a name stands for a colon."""
    given = {name.replace("__", ":"): value for name, value in changes.items()}
    return written(text, {**fields(text), **given})


def lines_changed(before: str, after: str) -> list[str]:
    found = difflib.ndiff(before.splitlines(), after.splitlines())
    return [line for line in found if line[0] in "+-"]


def faults(text: str) -> list[str]:
    return [str(fault) for fault in read_plan(text).faults]


@pytest.mark.parametrize("text", [TEXT, MACHINE_TEXT])
def test_a_form_sent_as_it_was_changes_nothing(text: str) -> None:
    assert sent(text) == text


def test_a_changed_field_changes_its_line_and_no_other() -> None:
    after = sent(queries="40")
    assert lines_changed(TEXT, after) == ["- queries_per_trial: 30", "+ queries_per_trial: 40"]
    after = sent(contact="Jo, jo@lab.example")
    assert lines_changed(TEXT, after) == ['+ contact: "Jo, jo@lab.example"']


def test_every_field_comes_back_as_it_was_typed() -> None:
    typed = {
        "languages": "en, ja",
        "title:en": 'No: "yes"',
        "title:ja": "水を注ぐ",
        "queries": "12",
        "trials": "2",
        "break": "0",
        "places": "30",
        "contact": "Jo",
        "amount": "4.5",
        "currency": "EUR",
        "familiarisation": "3",
        "platform": "prolific",
        "code:completed": "C1",
        "code:declined": "C2",
        "name:0": "with skip",
        "method:0": "pbpo-no-synthesis",
        "environment:0": "kitchen",
        "skip:0:en": "no",
        "skip:0:ja": "どちらも",
        "name:1": "last one wins",
        "method:1": "knockout",
        "environment:1": "kitchen",
    }
    after = written(TEXT, {**fields(TEXT), **typed})
    assert typed.items() <= fields(after).items()
    assert read_plan(after).faults == ()
    assert read_yaml(after).data["places"] == 30
    # All that the form does not know is there still, with nearly all comments.
    for key in ("practice", "resume", "parameters", "checks", "lease_minutes"):
        assert read_yaml(after).data[key] == read_yaml(TEXT).data[key]
    comments = [line for line in TEXT.splitlines() if line.lstrip().startswith("#")]
    kept = [line for line in comments if line in after.splitlines()]
    assert len(kept) >= len(comments) - 5


def test_what_is_wrong_is_written_as_typed_and_named_by_the_check() -> None:
    after = sent(queries="many", places="-1")
    messages = [str(fault) for fault in read_plan(after).faults]
    assert any("queries_per_trial: expected a whole number" in one for one in messages)
    assert any("places: expected" in one and "'-1'" in one for one in messages)


@pytest.mark.parametrize(
    ("typed", "amount"),
    [("4.5", 4.5), ("4,5", 4.5), ("5", 5), ("\uff14\uff0e\uff15", 4.5), ("1000", 1000)],
)
def test_an_amount_that_can_mean_one_number_is_that_number(typed: str, amount: float) -> None:
    after = sent(amount=typed, currency="EUR")
    assert as_mapping(read_yaml(after).data["reward"])["amount"] == amount
    assert not [one for one in read_plan(after).faults if "reward" in str(one)]


@pytest.mark.parametrize("typed", ["1,000", "1.000", "1_000", "1 000", "25%"])
def test_what_could_mean_two_numbers_stays_as_typed_and_is_named(typed: str) -> None:
    after = sent(amount=typed, currency="EUR", queries=typed)
    assert (fields(after)["amount"], fields(after)["queries"]) == (typed, typed)
    messages = [str(fault) for fault in read_plan(after).faults]
    for key in ("reward.amount", "queries_per_trial"):
        assert any(f"{key}: expected" in one and repr(typed) in one for one in messages), messages


def test_an_amount_that_the_form_sends_back_unchanged_is_not_doubted() -> None:
    before = sent(amount="4.5", currency="EUR").replace("4.5", "1.125")
    after = written(before, {**fields(before), "currency": "JPY"})
    assert as_mapping(read_yaml(after).data["reward"]) == {"amount": 1.125, "currency": "JPY"}


def test_an_emptied_field_goes_and_an_emptied_condition_too() -> None:
    after = sent(**{"break": "", "contact": ""})
    assert "break_s" not in read_yaml(after).data
    two = sent(name__1="second", method__1="knockout", environment__1="kitchen")
    one = written(two, {**fields(two), "name:0": ""})
    assert fields(one)["name:0"] == "second"
    assert "name:1" not in fields(one)


def test_settings_of_a_condition_that_the_form_does_not_show_stay() -> None:
    text = begin_plan("Pouring").replace(
        "    method: pbpo-threshold\n",
        "    method: pbpo-threshold\n    settings: {preset: paper-env1}\n",
        1,
    )
    after = sent(text, name__0="renamed")
    assert fields(after)["name:0"] == "renamed"
    assert "settings: {preset: paper-env1}" in after


def test_a_method_without_a_skip_takes_the_button_away() -> None:
    after = sent(method__0="knockout")
    assert "skip: {label" not in after.replace("#     label", "")
    assert fields(after)["skip:0:en"] == ""


@pytest.mark.parametrize("text", ["slug: a\nslug: b\n", "a: &x 1\nb: *x\n", "- a\n", "a: [\n"])
def test_a_file_that_is_broken_has_to_be_put_right_by_hand(text: str) -> None:
    with pytest.raises(Exception, match="line"):
        written(text, {"queries": "3", "languages": "en"})


def test_the_broken_file_is_named_for_what_it_is() -> None:
    with pytest.raises(UneditableError, match="each key once"):
        written("slug: a\nslug: b\n", {"queries": "3"})


def test_a_begun_plan_is_the_example_under_its_own_names() -> None:
    text = begin_plan("Pouring water!", "runs.csv", [{"name": "speed"}, {"name": "angle"}])
    plan = read_plan(text).plan
    assert plan is not None
    assert (plan.slug, plan.title) == ("pouring-water", "Pouring water!")
    assert [parameter.name for parameter in plan.parameters] == ["speed", "angle"]
    assert plan.environments["videos"].source == "runs.csv"
    assert "# How many pairs of videos a trial has" in text
    assert "kitchen" not in text


def test_a_list_becomes_ranges_whose_videos_machines_record() -> None:
    ranges = {
        "candidates": "ranges",
        "practice": "0",
        "familiarisation": "0",
        "min:0": "0,5",
        "max:0": "3",
        "scale:0": "log",
        "min:1": "-1",
        "max:1": "1.5",
        "step:1": "0.25",
        "constraints": "speed >= height\n\n speed + height <= 4 ",
        "ahead:0": "2",
        "lag:0": "1",
        "reuse:0": "false",
        "timeout_s:0": "60",
        "stop_sure": "0.9",
        "stop_within": "0.2",
    }
    after = sent(**ranges)
    plan = read_plan(after).plan
    assert plan is not None, faults(after)
    assert plan.space is not None
    assert (plan.space.low, plan.space.high) == ((0.5, -1), (3, 1.5))
    assert (plan.space.log, plan.space.step) == ((True, False), (None, 0.25))
    assert plan.constraints == ("speed >= height", "speed + height <= 4")
    kitchen = plan.environments["kitchen"]
    assert (kitchen.source, kitchen.rollout.ahead, kitchen.rollout.lag) == ("machine", 2, 1)
    assert (kitchen.rollout.reuse, kitchen.rollout.timeout_s) == (False, 60)
    assert kitchen.rollout.attempts == 3
    assert plan.stop is not None
    assert (plan.stop.sure, plan.stop.within) == (0.9, 0.2)

    # Other fields leave all of that as it is.
    again = sent(after, queries="12")
    assert lines_changed(after, again) == ["- queries_per_trial: 30", "+ queries_per_trial: 12"]

    back = sent(after, candidates="list", stop_sure="", stop_within="")
    found = read_plan(back).plan
    assert found is not None, faults(back)
    before = read_plan(TEXT).plan
    assert before is not None
    assert found.parameters == before.parameters
    assert (found.environments, found.constraints, found.stop) == (before.environments, (), None)


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ({"max:0": "0.1"}, "parameters[0].max: expected a number above min (0.5), got 0.1"),
        ({"max:0": "wide"}, "parameters[0].max: expected a number between"),
        ({"min:1": ""}, "parameters[1].min: expected min and max of every parameter or of none"),
        ({"attempts:0": "2.5"}, "rollout.attempts: expected a whole number from 1 to 20, got"),
        ({"lag:0": "5"}, "rollout.lag: expected 0 or 1, got 5"),
        ({"stop_within": "0.2"}, "stop.sure: expected a number from 0.5 to below 1"),
        ({"stop_sure": "95%"}, "stop.sure: expected a number from 0.5 to below 1"),
    ],
)
def test_what_a_machine_cannot_be_asked_for_is_kept_as_typed_and_named(
    typed: dict[str, str], said: str
) -> None:
    after = sent(MACHINE_TEXT, **typed)
    assert typed.items() <= fields(after).items()
    assert any(said in one for one in faults(after)), faults(after)


def test_a_parameter_is_added_and_another_goes_with_its_range() -> None:
    after = sent(MACHINE_TEXT, parameter__0="", parameter__3="speed", min__3="1", max__3="2")
    names = [one["name"] for one in map(as_mapping, as_list(read_yaml(after).data["parameters"]))]
    assert names == ["politeness", "acceleration", "speed"]
    assert faults(after) == []
