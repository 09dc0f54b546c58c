"""Any text as `study.yaml`: faults with their lines, or a study, and never an error of ours."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from app.study import plan_form
from app.study.folder import load
from app.study.plan import plan_hash
from app.study.plan_source import read_plan
from app.study.validation_errors import StudyFaults
from app.study.yaml_edit import UneditableError
from app.study.yaml_source import YamlSyntaxError
from tests.conftest import SHORT_PLAN

#: Each of them stopped the pages of a draft, or would stop one part of what reads it.
ODD = [
    "1:" * 20_000 + "1",
    "1:1:1:1:1:1:1:1:1:1:1:1:1:1:1:1:1:1:1:1",
    "-1:" + "59:" * 15 + "59.5",
    "9" * 5_000,
    "9" * 50,
    "0x" + "f" * 5_000,
    "0x" + "f" * 40,
    "0b" + "1" * 9_000,
    "0" + "7" * 50,
    "1_0",
    ".inf",
    "-.inf",
    ".nan",
    "1e999999",
    "1.0e+999999",
    "0000-00-00",
    "9999-99-99",
    "2001-02-30",
    "2001-01-01T00:00:00+99:99",
    "2001-12-14t21:59:43.10-25:00",
    "0001-01-01T00:00:00+10:00",
    "9999-12-31T23:59:59-10:00",
    "2001-01-01T99:99:99Z",
    "!!int abc",
    "!!int ''",
    "!!float abc",
    "!!bool maybe",
    "!!timestamp abc",
    "!!null x",
    "!!binary é",
    "!!binary aGFsbG8=",
    "!!python/object:os.system x",
    "!!set {a, b}",
    "!!omap [a: 1]",
    "!!pairs [a: 1]",
    "!!str {a: 1}",
    "!!map [1]",
    "! x",
    "!local x",
    "{<<: {a: 1}}",
    "{<<: 1}",
    "{[1]: 2}",
    "{{a: 1}: 2}",
    "{? : 1}",
    "{null: 1, true: 2, 1.5: 3}",
    "{1: a, '1': b}",
    "=",
    "<<",
    "[" * 60 + "]" * 60,
    "&a [*a]",
    "|\n  x\n ",
    '"\\uD800"',
    '"\\0"',
    "'" + "x" * 10_000 + "'",
    "[" + "1, " * 500 + "1]",
]

LINES = SHORT_PLAN.splitlines()
KEYS = [line.partition(":")[0] for line in LINES if line and line[0] not in " #-"]


def with_value(key: str, value: str) -> str:
    """The short study's plan with another value for one of its keys."""
    kept, skipping = [], False
    for line in LINES:
        if line and line[0] not in " #-":
            skipping = line.startswith(f"{key}:")
        if not skipping:
            kept.append(line)
    return "\n".join([*kept, f"{key}: {value}", ""])


def read_everywhere(text: str) -> None:
    """What the pages of a draft do with its `study.yaml`."""
    reading = read_plan(text)
    assert (reading.plan is None) == bool(reading.faults)
    for fault in reading.faults:
        str(fault), fault.parts
        assert len(fault.message) < 1_100
    if reading.plan is not None:
        plan_hash(reading.plan, {})
        reading.plan.model_dump_json()
    with contextlib.suppress(YamlSyntaxError, UneditableError):
        found = plan_form.fields(text)
        plan_form.environments(text)
        for change in (
            {"title:en": "Another"},
            {"name:0": "x"},
            {"languages": ""},
            {"amount": "1"},
        ):
            plan_form.written(text, {**found, **change})


@pytest.mark.parametrize("value", ODD)
def test_an_odd_value_is_a_fault_or_a_value_wherever_it_stands(value: str) -> None:
    began = time.monotonic()
    for key in ("version", "title", "contact", "parameters", "conditions", "reward", "languages"):
        read_everywhere(with_value(key, value))
    read_everywhere(f"{value}: 1\n")
    read_everywhere(value)
    assert time.monotonic() - began < 60


SCALARS = st.one_of(
    st.sampled_from([value for value in ODD if len(value) < 200]),
    st.text(max_size=20),
    st.integers().map(str),
    st.floats().map(str),
    st.from_regex(r"\A[-+0-9.:_eExXbTZ]{1,25}\Z"),
)


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(key=st.sampled_from([*KEYS, "reward", "recruitment", "checks", "new"]), value=SCALARS)
@example(key="version", value="1:" * 3_000 + "1")
def test_no_value_is_a_fault_of_ours(key: str, value: str) -> None:
    read_everywhere(with_value(key, value))


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    at=st.integers(0, len(SHORT_PLAN)),
    length=st.integers(0, 30),
    put=st.one_of(SCALARS, st.text(alphabet="{}[]:-#&*!|>'\"%@`, \n\t?<=", max_size=8)),
)
def test_no_piece_of_text_in_a_plan_is_a_fault_of_ours(at: int, length: int, put: str) -> None:
    read_everywhere(SHORT_PLAN[:at] + put + SHORT_PLAN[at + length :])


def test_a_file_of_faults_is_answered_shortly_and_soon() -> None:
    began = time.monotonic()
    reading = read_plan("".join(f"key{number}: 1\n" for number in range(7_000)))
    assert len(reading.faults) < 300
    assert "more faults" in str(reading.faults[0])
    assert time.monotonic() - began < 30


@pytest.mark.parametrize(
    "cell", [".", "./", "日" * 200 + ".mp4", "a/" * 150 + "b.mp4", "x" * 5_000, "study.yaml/a.mp4"]
)
@pytest.mark.parametrize("where", ["table", "source"])
def test_a_name_that_no_file_can_have_is_a_fault(tmp_path: Path, cell: str, where: str) -> None:
    folder = tmp_path / "study"
    folder.mkdir()
    source = "recordings.csv" if where == "table" else f"{cell}.csv"
    plan = with_value("environments", f"{{env1: {{source: {source!r}}}}}")
    (folder / "study.yaml").write_text(plan, encoding="utf-8")
    (folder / "recordings.csv").write_text(f"w0,w1,file\n0,0,{cell}\n", encoding="utf-8")
    with pytest.raises(StudyFaults) as found:
        load(folder)
    assert all(len(fault.message) < 1_100 for fault in found.value.faults)


def test_links_that_lead_to_each_other_are_a_fault(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").symlink_to(tmp_path / "b.yaml")
    (tmp_path / "b.yaml").symlink_to(tmp_path / "study.yaml")
    with pytest.raises(StudyFaults, match="expected a file"):
        load(tmp_path)
