"""Slips of YAML are named as a person would, as many at once as there are, and can be mended."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from app.study.plan_source import read_plan
from app.study.yaml_slips import mend

from .conftest import STUDY_YAML


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("title: Kettles", "title: Kettles: a pilot", 'title: "Kettles: a pilot"'),
        ("label: Neither", "label: I don't: both", 'label: "I don\'t: both"'),
        ("label: Neither", "label: 'I don't like it'", 'label: "I don\'t like it"'),
        ("unit: m/s", "unit: %", 'unit: "%"'),
        ("title: Kettles", "title: @home", 'title: "@home"'),
        ("title: Kettles", 'title: "Kettles', 'title: "Kettles"'),
        ("    method: pbpo\n", "   method: pbpo\n", "expected 4 spaces at the beginning"),
        ("  - name: with skip", "\t- name: with skip", "expected spaces at the beginning"),
    ],
)
def test_a_slip_is_named_by_what_to_write(old: str, new: str, said: str) -> None:
    text = STUDY_YAML.replace(old, new, 1)
    reading = read_plan(text)
    [fault] = reading.faults
    assert said in fault.message
    line = next(n for n, one in enumerate(text.splitlines(), start=1) if new.strip() in one)
    assert fault.line == line
    mended = mend(text)
    assert mended is not None
    assert read_plan(mended.text).plan is not None


def test_several_slips_and_other_faults_are_named_at_once() -> None:
    text = STUDY_YAML.replace("title: Kettles", "title: Kettles: hot")
    text = text.replace("label: Neither", "label: No: neither").replace("trial: 4", "trial: many")
    messages = [fault.message for fault in read_plan(text).faults]
    assert ["quotes" in message for message in messages] == [True, True, False]
    assert "queries_per_trial" in messages[2]


@pytest.mark.parametrize("text", ["[" * 5_000, "a: [", "{", "\0", "a: b\n" * 9_000])
def test_what_no_remedy_helps_is_left(text: str) -> None:
    assert mend(text) is None


@pytest.mark.parametrize("word", ["no", "off", "Yes"])
def test_a_word_that_yaml_reads_as_a_truth_value_is_said_to_need_quotes(word: str) -> None:
    text = STUDY_YAML.replace("label: Neither", f"label: {word}")
    [fault] = read_plan(text).faults
    assert "put quotes around the word" in fault.message


def test_a_list_of_one_wrong_entry_is_one_fault(
    folder: Path, edit: Callable[[Path, str, str], None], faults: Callable[[Path], list[str]]
) -> None:
    text = (folder / "study.yaml").read_text()
    start = text.index("  - name: without skip")
    end = text.index("queries_per_trial")
    (folder / "study.yaml").write_text(text[:start] + text[end:])
    edit(folder / "study.yaml", "method: pbpo\n", "method: pppo\n")
    assert len(faults(folder)) == 1
