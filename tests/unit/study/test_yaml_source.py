"""YAML is read with the line of every key and item, and nothing is lost without a word."""

import pytest

from app.study.yaml_source import YamlSyntaxError, read_yaml

TEXT = """\
# a comment
title: Kettles
conditions:
  - name: a
    skip: {label: Neither,
           more: [1, 2]}

  - name: b
"""


@pytest.mark.parametrize(
    ("place", "line"),
    [
        (("title",), 2),
        (("conditions",), 3),
        (("conditions", 0), 4),
        (("conditions", 0, "name"), 4),
        (("conditions", 0, "skip", "label"), 5),
        (("conditions", 0, "skip", "more", 1), 6),
        (("conditions", 1, "name"), 8),
        # What is not there is looked for where it would have stood.
        (("conditions", 1, "skip", "label"), 8),
        (("conditions", 7), 3),
        (("slug",), 2),
    ],
)
def test_every_place_knows_its_line(place: tuple[str | int, ...], line: int) -> None:
    assert read_yaml(TEXT).line(place) == line


def test_values_are_read_as_yaml_reads_them() -> None:
    source = read_yaml("a: 1\nb: 1.5\nc: 'no'\nd: no\ne:\nf: [x, {y: 2}]\n")
    assert source.data == {"a": 1, "b": 1.5, "c": "no", "d": False, "e": None, "f": ["x", {"y": 2}]}


def test_keys_stay_as_they_are_written() -> None:
    assert read_yaml("no: 1\n2: 3\n").data == {"no": 1, "2": 3}


def test_a_key_that_comes_twice_is_named_with_both_lines_and_the_first_is_kept() -> None:
    source = read_yaml("a:\n  b: 1\n  c: 2\n  b: 3\n")
    assert source.data == {"a": {"b": 1, "c": 2}}
    [problem] = source.problems
    assert problem.line == 4
    assert problem.message == "a.b: expected each key once, got it again (first in line 2)"


def test_a_key_that_is_no_word_is_named() -> None:
    [problem] = read_yaml("a: 1\n? [x, y]\n: 2\n").problems
    assert (problem.line, problem.message[:21]) == (2, "expected a plain word")


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", 3, "expected YAML"),
        ("a: 1\n\tb: 2\n", 2, "expected YAML"),
        ("a: 'b\n\n", 3, "expected YAML"),
        ("a: 1\nb: 2\x01\n", 2, "got the character"),
        ("a: 1\n---\nb: 2\n", 2, "expected YAML"),
        ("a: &x 1\nb: *x\n", 2, r"got the alias \*x"),
        ("a: &x\n  - *x\n", 2, r"got the alias \*x"),
        ("a: 1\nb: !!python/object:os.system x\n", 2, "got 'x'"),
        ("a: 1\nb: 2024-13-41\n", 2, "got '2024-13-41'"),
        ("a:\n  " + "[" * 60 + "]" * 60, 2, "at most 50 levels"),
        ("", 1, "got nothing"),
        ("# only a comment\n", 1, "got nothing"),
        ("- a\n- b\n", 1, "got something else"),
        ("just words", 1, "got something else"),
    ],
)
def test_what_is_no_study_at_all_is_refused_with_its_line(
    text: str, line: int, message: str
) -> None:
    with pytest.raises(YamlSyntaxError, match=message) as caught:
        read_yaml(text)
    assert caught.value.problem.line == line


@pytest.mark.parametrize(
    ("written", "read_as"),
    [("1_000", "1000"), ("010", "8"), ("1:30", "90"), ("0x10", "16"), ("1_0.5", "10.5")],
)
def test_a_number_that_yaml_reads_as_another_is_named(written: str, read_as: str) -> None:
    (problem,) = read_yaml(f"queries_per_trial: {written}\n").problems
    assert written in problem.message
    assert f"which YAML reads as {read_as}" in problem.message
    assert problem.line == 1


@pytest.mark.parametrize(
    "written", ["0", "10", "-3", "0.5", ".5", "5.", "1.0e+3", "'1_000'", "yes"]
)
def test_a_plain_number_is_not_doubted(written: str) -> None:
    assert not read_yaml(f"value: {written}\n").problems
