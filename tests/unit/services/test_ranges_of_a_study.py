"""A study over ranges: what its file may say, and the line of what it may not."""

from collections.abc import Mapping
from typing import Any

import pytest

from app.pbbo import box
from app.services.proposals import boxes
from app.services.studies import repository
from app.study import plan_hash
from app.study.plan import Plan
from app.study.plan_source import read_plan
from app.study.search_space import MOST_PARAMETERS

STUDY_YAML = """\
version: 1
slug: arms
title: Arms
languages: [en]
parameters:
  - {name: speed, unit: m/s, min: 0.1, max: 10, scale: log}
  - {name: height, min: 0, max: 1, step: 0.25}
constraints:
  - speed + 2 * height <= 6
  - height <= 0.9
environments:
  lab: {source: machine, rollout: {timeout_s: 60}}
conditions:
  - name: ranges
    method: pbpo-threshold
    environment: lab
    skip: {label: Neither}
queries_per_trial: 4
"""


def faults_of(old: str, new: str) -> list[str]:
    assert STUDY_YAML.count(old) == 1
    text = STUDY_YAML.replace(old, new)
    reading = read_plan(text, repository.settings_fault, boxes.space_faults)
    return [str(fault) for fault in reading.faults]


def plan_of(text: str = STUDY_YAML) -> Plan:
    reading = read_plan(text, repository.settings_fault, boxes.space_faults)
    assert reading.plan is not None, reading.faults
    return reading.plan


def test_ranges_and_constraints_make_the_optimisers_box() -> None:
    space = boxes.box_of(plan_of())
    assert (space.low, space.high) == ((0.1, 0.0), (10.0, 1.0))
    assert (space.step, space.log) == ((None, 0.25), (True, False))
    assert space.names == ("speed", "height")
    assert space.constraints == ("speed + 2 * height <= 6", "height <= 0.9")


def test_settings_of_rollouts_have_defaults() -> None:
    environment = plan_of().environments["lab"]
    assert environment.is_machine
    assert not environment.is_crane_machine
    assert environment.rollout.model_dump() == {
        "timeout_s": 60,
        "attempts": 3,
        "reuse": True,
        "new_per_query": 1,
        "ahead": 3,
        "lag": 0,
    }


def test_a_plan_over_ranges_is_the_same_after_it_was_stored() -> None:
    plan = plan_of()
    again = Plan.model_validate(plan.model_dump(mode="json"))
    assert again == plan
    assert plan_hash(again, {}) == plan_hash(plan, {})


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("max: 10,", "max: 11,"),
        (", scale: log", ""),
        ("step: 0.25", "step: 0.2"),
        ("  - height <= 0.9\n", ""),
        ("timeout_s: 60", "timeout_s: 61"),
        ("source: machine,", "source: machine, label: Lab,"),
    ],
)
def test_each_part_of_ranges_and_rollouts_counts_in_the_hash(old: str, new: str) -> None:
    assert plan_hash(plan_of(STUDY_YAML.replace(old, new)), {}) != plan_hash(plan_of(), {})


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("waste-crane", "5fcbbb3c226c0a6d81e5b896535ab49bf9e300189c65c4f311ed21d2626df148"),
        ("waste-crane-env2", "0584ca990baf12806e48a5a8d54bf5887c7a2d819167a19c4de250263e4b5751"),
        ("waste-crane-paper", "56694d151db54714d79599f70206c2a9bb4c86f72632e12492b7a0e8957e82e2"),
    ],
)
def test_studies_of_earlier_versions_keep_the_hash_of_their_plan(name: str, digest: str) -> None:
    folder = repository.load_folder(name)
    # The texts' own corrections may change it; its plan's part may not.
    assert plan_hash(folder.plan, folder.texts, folder.recordings) == digest


def test_the_plan_and_the_optimiser_agree_on_the_number_of_parameters() -> None:
    assert MOST_PARAMETERS == box.MOST_PARAMETERS


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("min: 0.1, ", "", "study.yaml:6: parameters[0].min: expected min and max of every"),
        ("min: 0, max: 1, ", "", "study.yaml:7: parameters[1].min: expected min and max of every"),
        ("max: 10,", "max: 0.1,", "study.yaml:6: parameters[0].max: expected a number above min"),
        (
            "{label: Neither}",
            "{label: Neither}\n    model: shared",
            "study.yaml:18: conditions[0].model: expected a model of each person's own where",
        ),
        ("max: 10,", "max: .inf,", "study.yaml:6: parameters[0].max: expected a number between"),
        ("max: 10,", "max: true,", "study.yaml:6: parameters[0].max: expected a number between"),
        ("max: 10,", "max: 1.0e+13,", "study.yaml:6: parameters[0].max: expected a number between"),
        (
            "min: 0, max: 1,",
            "min: 1000000000, max: 1000000001,",
            "study.yaml:7: parameters[1].max: expected a range of at least 1e-06 of its bounds",
        ),
        ("min: 0.1,", "min: 0,", "study.yaml:6: parameters[0].min: expected a number above 0 on"),
        ("step: 0.25", "step: 0", "study.yaml:7: parameters[1].step: expected a number above 0"),
        ("step: 0.25", "step: 2", "study.yaml:7: parameters[1].step: expected a step of at most"),
        ("scale: log", "scale: loq", "study.yaml:6: parameters[0].scale: expected linear or log"),
        ("name: speed", "name: video", "study.yaml:6: parameters[0].name: expected another name"),
        (
            "height <= 0.9",
            "height <= deep",
            (
                "study.yaml:10: constraints[1]: constraint 'height <= deep': expected parameters"
                " from speed, height, got 'deep'"
            ),
        ),
        ("height <= 0.9", "height < 0.9", "study.yaml:10: constraints[1]: constraint 'height <"),
        (
            "height <= 0.9",
            "height * speed <= 1",
            "study.yaml:10: constraints[1]: constraint 'height * speed <= 1': expected linear",
        ),
        ("height <= 0.9", "height >= 2", "study.yaml:10: constraints[1]: expected a point within"),
        ("height <= 0.9", "height <= 0", "study.yaml:10: constraints[1]: expected room for more"),
        (
            "height <= 0.9",
            "speed >= 8",
            "study.yaml:8: constraints: expected a point within the bounds that satisfies all of",
        ),
        ("source: machine,", "source: crane,", "study.yaml:12: environments.lab.source: expected"),
        (
            "lab: {source: machine, rollout: {timeout_s: 60}}",
            "lab: {source: a.csv, rollout: {timeout_s: 60}}",
            "study.yaml:12: environments.lab.rollout: expected no rollout settings for source",
        ),
        (
            "timeout_s: 60",
            "timeout: 60",
            "study.yaml:12: environments.lab.rollout.timeout: unknown key",
        ),
        (
            "timeout_s: 60",
            "timeout_s: 0",
            "study.yaml:12: environments.lab.rollout.timeout_s: expected whole seconds",
        ),
        (
            "timeout_s: 60",
            "new_per_query: 3",
            "study.yaml:12: environments.lab.rollout.new_per_query: expected 1 or 2, got 3",
        ),
        (
            "timeout_s: 60",
            "lag: 2",
            "study.yaml:12: environments.lab.rollout.lag: expected 0 or 1, got 2",
        ),
        (
            "method: pbpo-threshold",
            "method: pbpo",
            "study.yaml:15: conditions[0].method: expected pbpo-threshold for parameters with",
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: 4\nfamiliarisation: {videos: 3}",
            (
                "study.yaml:19: familiarisation.videos: expected 0, a study over ranges has no"
                " videos before its first query, got 3"
            ),
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: 4\npractice: {queries: 2}",
            "study.yaml:19: practice.queries: expected 0, a study over ranges has no videos",
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: 4\nchecks: {attention: 0.25}",
            "study.yaml:19: checks.attention: expected 0, a study over ranges has no videos",
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: 4\ndevice_check: {min_width_px: 320}",
            "study.yaml:19: device_check: expected no device check, a study over ranges has no",
        ),
        (
            "conditions:",
            "  hall: {source: machine}\nconditions:",
            "study.yaml:13: environments.hall.source: expected a condition in environment hall",
        ),
    ],
)
def test_a_fault_in_a_study_over_ranges_is_named_with_its_line(
    old: str, new: str, expected: str
) -> None:
    assert any(fault.startswith(expected) for fault in faults_of(old, new)), faults_of(old, new)


def without_ranges(**changes: Any) -> Mapping[str, Any]:
    plan = {
        "version": 1,
        "slug": "arms",
        "title": "Arms",
        "languages": ["en"],
        "parameters": [{"name": "speed"}],
        "environments": {"lab": {"source": "recordings.csv"}},
        "conditions": [{"name": "a", "method": "knockout", "environment": "lab"}],
        "queries_per_trial": 4,
    }
    return {**plan, **changes}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"environments": {"lab": {"source": "machine"}}}, "min and max of every parameter for a"),
        ({"constraints": ["speed <= 1"]}, "min and max of every parameter beside constraints"),
        ({"parameters": [{"name": "speed", "step": 1}]}, "min and max beside step"),
        ({"parameters": [{"name": "speed", "scale": "log"}]}, "min and max beside scale"),
    ],
)
def test_a_machine_and_parts_of_ranges_need_ranges(changes: Any, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        Plan.model_validate(without_ranges(**changes))


def test_nine_parameters_are_too_many_for_ranges() -> None:
    nine = "".join(f"\n  - {{name: p{place}, min: 0, max: 1}}" for place in range(7))
    assert any(
        fault.startswith("study.yaml:5: parameters: expected at most 8 parameters with ranges, got")
        for fault in faults_of("\nconstraints:", f"{nine}\nconstraints:")
    )


def test_the_crane_as_a_machine_takes_its_own_parameters_within_their_bounds() -> None:
    faults = faults_of("source: machine,", "source: machine crane,")
    assert [fault.partition(": expected ")[2] for fault in faults] == [
        "0 to 1 s for source machine crane, got 10",
        "env1 or env2 for source machine crane, got 'lab'",
        "the parameters w0, w1 for source machine crane, got speed, height",
    ]


def test_a_study_over_ranges_may_repeat_queries() -> None:
    assert faults_of("queries_per_trial: 4", "queries_per_trial: 4\nchecks: {repeats: 0.25}") == []
