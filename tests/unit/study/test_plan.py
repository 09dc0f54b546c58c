"""What a plan may say, and when two plans are the same study."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from app.study import METHODS, Plan, RecordingRow, plan_hash

ROW = RecordingRow("kitchen", (0.1,), "videos/a.mp4", "ab" * 32, 10.0, -3.5)
TEXTS = {"en": {"consent": "Agree?", "instructions": "Look.", "debrief": "Thanks."}}
BuildPlan = Callable[..., Plan]


def condition(**changes: object) -> dict[str, object]:
    return {"name": "a", "method": "knockout", "environment": "kitchen", **changes}


def test_what_is_left_out_has_a_sound_default(build_plan: BuildPlan) -> None:
    plan = build_plan()
    assert (plan.trials_per_condition, plan.break_s, plan.order) == (1, 120, "counterbalanced")
    assert (plan.familiarisation.videos, plan.familiarisation.required) == (0, 0)
    assert plan.session_expires_after_days == 14
    assert plan.conditions[0].settings == {}


def test_a_plan_counts_its_trials_and_finds_its_environments(build_plan: BuildPlan) -> None:
    plan = build_plan(trials_per_condition=3)
    assert plan.trials == 6
    assert plan.environment_of(plan.conditions[1]) is plan.environments["kitchen"]


def test_a_text_is_given_in_the_language_asked_for_or_else_the_first(
    build_plan: BuildPlan,
) -> None:
    plan = build_plan(languages=["en", "ja"], title={"en": "Kettles", "ja": "やかん"})
    assert plan.text(plan.title, "ja") == "やかん"
    assert plan.text(plan.title, "fr") == "Kettles"
    assert plan.text("Kettles", "ja") == "Kettles"
    assert plan.text({"ja": "やかん"}, "en") == "やかん"


def test_a_plan_goes_through_json_unchanged(build_plan: BuildPlan) -> None:
    plan = build_plan(
        conditions=[
            condition(
                method="pbpo", skip={"label": "Neither"}, settings={"noise": 0.01, "n": [1, None]}
            )
        ],
        contact="jo@example.org",
    )
    through_json = json.loads(json.dumps(plan.model_dump(mode="json")))
    assert Plan.model_validate(through_json) == plan


def test_what_is_shared_and_what_it_is_for_is_part_of_the_plan(build_plan: BuildPlan) -> None:
    own = condition(method="pbpo-threshold", skip={"label": "Neither"})
    said = [{}, {"model": "shared"}, {"model": "shared", "for": "person"}]
    plans = [build_plan(conditions=[{**own, **more}]) for more in said]
    assert len({plan_hash(plan, TEXTS) for plan in plans}) == 3
    for plan, finds in zip(plans[1:], ("population", "person"), strict=True):
        assert Plan.model_validate(plan.model_dump(mode="json")).conditions[0].finds == finds
    # The hash of a plan that was stored before there were shared models holds.
    explicit = build_plan(conditions=[{**own, "model": "own"}])
    assert plan_hash(explicit, TEXTS) == plan_hash(plans[0], TEXTS)


def test_a_plan_does_not_change(build_plan: BuildPlan) -> None:
    with pytest.raises(ValidationError, match="frozen"):
        build_plan().queries_per_trial = 5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"queries_per_trial": 0}, "queries_per_trial"),
        ({"queries_per_trial": "30"}, "queries_per_trial"),
        ({"queries_per_trial": True}, "queries_per_trial"),
        ({"break_s": -1}, "break_s"),
        ({"slug": "-x"}, "slug"),
        ({"slug": "x\n"}, "slug"),
        ({"slug": "x" * 61}, "slug"),
        ({"languages": ["en\n"]}, "languages"),
        ({"languages": ["../en"]}, "languages"),
        ({"title": " "}, "title"),
        ({"unknown": 1}, "unknown"),
        ({"conditions": []}, "conditions"),
        ({"conditions": [condition(environment="x")]}, "expected one of the environments"),
        ({"conditions": [condition(skip={"label": "S"})]}, "expected no skip button"),
        ({"conditions": [condition(method="pbpo")]}, "expected a skip button's label"),
        ({"conditions": [condition(), condition()]}, "expected each once, got 'a' again"),
        ({"conditions": [condition(settings={"a": {"b": float("inf")}})]}, "finite number"),
        ({"parameters": [{"name": "candidate"}]}, "'candidate' is a column"),
        ({"familiarisation": {"videos": 1, "required": 2}}, r"at most the number of videos \(1\)"),
        ({"languages": ["en", "ja"]}, "got none in ja"),
        ({"title": {"en": "Kettles", "fr": "Bouilloires"}}, "got 'fr'"),
        ({"environments": {"kitchen": {"source": "/a.csv"}}}, "inside the study folder"),
        ({"environments": {"kitchen": {"source": "crane"}}}, "expected env1 or env2"),
        (
            {"environments": {"kitchen": {"source": "a.csv"}, "lab": {"source": "a.csv"}}},
            "expected a file of its own, got 'a.csv', which kitchen has",
        ),
    ],
)
def test_a_plan_that_makes_no_sense_is_never_born(
    build_plan: BuildPlan, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ValidationError, match=message):
        build_plan(**changes)


def test_the_crane_has_its_own_two_parameters(build_plan: BuildPlan) -> None:
    crane: dict[str, object] = {
        "environments": {"env1": {"source": "crane"}},
        "conditions": [condition(environment="env1")],
    }
    with pytest.raises(ValidationError, match=r"expected the parameters w0, w1 .* got speed"):
        build_plan(**crane)
    plan = build_plan(**crane, parameters=[{"name": "w0"}, {"name": "w1"}])
    assert plan.environments["env1"].is_crane


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_a_method_has_a_skip_button_exactly_if_it_has_a_use_for_one(
    build_plan: BuildPlan, method: Any
) -> None:
    with_skip = condition(method=method.name, skip={"label": "Skip"})
    without = condition(method=method.name)
    sound, unsound = (with_skip, without) if method.allows_skip else (without, with_skip)
    assert build_plan(conditions=[sound]).conditions[0].method == method.name
    with pytest.raises(ValidationError, match="skip button"):
        build_plan(conditions=[unsound])


# The hash


def test_the_hash_is_the_same_for_the_same_study(build_plan: BuildPlan) -> None:
    first, second = (plan_hash(build_plan(), TEXTS, [ROW]) for _ in range(2))
    assert first == second
    assert len(first) == 64
    assert set(first) <= set("0123456789abcdef")


CHANGES: list[dict[str, object]] = [
    {"slug": "pots"},
    {"title": "Pots"},
    {"parameters": [{"name": "speed", "unit": "m/s"}]},
    {"queries_per_trial": 4},
    {"trials_per_condition": 2},
    {"order": "fixed"},
    {"break_s": 0},
    {"familiarisation": {"videos": 3}},
    {"session_expires_after_days": 15},
    {"contact": "jo@example.org"},
    {"reward": {"amount": 4.5, "currency": "EUR"}},
    {"conditions": [condition()]},
    {"conditions": [condition(settings={"noise": 0.1})]},
    {"conditions": [condition(name="b"), condition()]},
    {"environments": {"kitchen": {"source": "others.csv"}}},
]


def test_any_setting_changes_the_hash(build_plan: BuildPlan) -> None:
    hashes = {plan_hash(build_plan(**change), TEXTS, [ROW]) for change in [{}, *CHANGES]}
    assert len(hashes) == len(CHANGES) + 1


@pytest.mark.parametrize(
    "texts",
    [
        {"en": {**TEXTS["en"], "consent": "Agree!"}},
        {"en": {**TEXTS["en"], "debrief": "Thanks. "}},
        {**TEXTS, "ja": TEXTS["en"]},
    ],
)
def test_any_text_changes_the_hash(
    build_plan: BuildPlan, texts: Mapping[str, Mapping[str, str]]
) -> None:
    assert plan_hash(build_plan(), texts, [ROW]) != plan_hash(build_plan(), TEXTS, [ROW])


@pytest.mark.parametrize(
    "rows",
    [
        [],
        [replace(ROW, sha256="cd" * 32)],
        [replace(ROW, candidate=(0.2,))],
        [replace(ROW, file="videos/b.mp4")],
        [replace(ROW, score=None)],
        [replace(ROW, environment="lab")],
        [replace(ROW, duration_s=9.0)],
        [ROW, replace(ROW, file="videos/b.mp4", sha256="ef" * 32)],
    ],
)
def test_any_recording_changes_the_hash(build_plan: BuildPlan, rows: list[RecordingRow]) -> None:
    assert plan_hash(build_plan(), TEXTS, rows) != plan_hash(build_plan(), TEXTS, [ROW])


def test_the_order_of_recordings_counts_because_it_numbers_the_candidates(
    build_plan: BuildPlan,
) -> None:
    rows = [ROW, replace(ROW, file="videos/b.mp4", sha256="ef" * 32)]
    hashes = {plan_hash(build_plan(), TEXTS, order) for order in (rows, rows[::-1])}
    assert len(hashes) == 2
