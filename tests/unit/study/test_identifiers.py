"""Values of a link's parameters: which name a person, and which name nobody."""

from __future__ import annotations

from urllib.parse import quote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.identifiers import LONGEST_ID, Given, UnreadableIdError, identifies_no_one, read

UNFILLED = [
    "{{%PROLIFIC_PID%}}",
    "{{PROLIFIC_PID}}",
    "{%PROLIFIC_PID%}",
    "%SURVEY_CODE%",
    "${PROLIFIC_PID}",
    "${e://Field/PROLIFIC_PID}",
    "[[id]]",
    "[%RID%]",
    "<id>",
    "{TOKEN}",
    "#{id}",
    "#u_0#",
    "*|EMAIL|*",
    "__PID__",
    "$PID",
    "PROLIFIC_PID",
    "XXXX",
    "%s",
    "\\u007bid\\u007d",
    "%u007bid%u007d",
    "=7Bid=7D",
    "YOUR_ID_HERE",
    "Insert+your+Prolific+ID",
    "sona_id=",
    "\uff5b\uff5bid\uff5d\uff5d",
]
BLANK = ["", " ", "\t\n", "\u3000\xa0", "\u200b\u2060\ufeff", "\u3164", "\u2800", "-", "?", "..."]
WORDS = ["undefined", "NULL", "None", "nan", "N/A", "n.a.", "(null)", "[object Object]", "test"]
WORDS += ["not available", "not_set", "undefinedundefined", "null,null", "no id", "未設定", "なし"]
WORDS += ["ASSIGNMENT_ID_NOT_AVAILABLE", "0", "00000000-0000-0000-0000-000000000000"]


@pytest.mark.parametrize("value", [*UNFILLED, *BLANK, *WORDS])
def test_what_nobody_filled_in_stands_for_nobody_in_every_encoding(value: str) -> None:
    once = quote(value, safe="")
    often = once
    for _ in range(8):
        often = quote(often, safe="")
    spaced = f"\u200b {value}\u3000"
    for written in (value, once, quote(once), often, spaced, quote(spaced)):
        assert identifies_no_one(written), written
        assert read(["PROLIFIC_PID"], [("PROLIFIC_PID", written)]) == Given({}, ("PROLIFIC_PID",))


@pytest.mark.parametrize(
    "value",
    [
        "5f0c1ada9b2c3d4e5f6a7b8c",
        "4711",
        "007",
        "A2XYZ-1",
        "s&x",
        "a b",
        "Ida",
        "R_1nA=",
        "https://www.mturk.com",
    ],
)
def test_an_id_names_somebody(value: str) -> None:
    assert read(["id"], [("id", value)]) == Given({"id": value})


@given(st.from_regex(r"[0-9a-f]{24}", fullmatch=True).filter(lambda value: set(value) != {"0"}))
def test_every_id_of_prolifics_form_names_somebody(value: str) -> None:
    assert not identifies_no_one(value, "PROLIFIC_PID")


def test_an_id_is_read_without_what_nobody_sees_and_under_a_name_in_any_case() -> None:
    came = [("prolific_pid", " \u20035f\u200b0c\ufeff\n"), ("Session_Id", "s1"), ("other", "x")]
    names = ["PROLIFIC_PID", "SESSION_ID"]
    assert read(names, came) == Given({"PROLIFIC_PID": "5f0c", "SESSION_ID": "s1"})


def test_of_a_parameter_that_came_twice_only_one_value_is_taken() -> None:
    assert read(["id"], [("id", "a"), ("ID", " a ")]) == Given({"id": "a"})
    assert read(["id"], [("id", "{{id}}"), ("id", "a")]) == Given({"id": "a"})
    with pytest.raises(UnreadableIdError, match="id: expected one value, got two that differ"):
        read(["id"], [("id", "a"), ("Id", "b")])


def test_an_id_that_is_too_long_is_refused_and_not_cut() -> None:
    assert read(["id"], [("id", "a" * LONGEST_ID)]).ids["id"] == "a" * LONGEST_ID
    with pytest.raises(UnreadableIdError, match="expected at most 200 characters, got 201"):
        read(["id"], [("id", "a" * (LONGEST_ID + 1))])
    with pytest.raises(UnreadableIdError, match="control characters"):
        read(["id"], [("id", "a\x00b")])
