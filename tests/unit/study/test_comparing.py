"""What a plan may say of the comparisons themselves."""

from collections.abc import Callable
from pathlib import Path

import pytest

Edit = Callable[[Path, str, str], None]
Faults = Callable[[Path], list[str]]

REASONS = "skip: {label: Neither, reasons: {both_bad: Both are bad, cannot_tell: I cannot tell}}"


def test_a_skip_may_offer_reasons_and_both_videos_may_have_to_be_seen(
    folder: Path, edit: Edit, faults: Faults
) -> None:
    edit(folder / "study.yaml", "skip: {label: Neither}", REASONS)
    edit(
        folder / "study.yaml",
        "queries_per_trial: 4",
        "queries_per_trial: 4\nquery: {watch_once: true}",
    )
    assert faults(folder) == []


@pytest.mark.parametrize(
    ("new", "expected"),
    [
        (
            "skip: {label: Neither, reasons: {both_bad: Both are bad}}",
            (
                "study.yaml:14: conditions[0].skip.reasons: expected a mapping of 2 to 4"
                " reasons, each with its text, such as {both_bad: Both are bad,"
                " cannot_tell: I cannot tell}, got a mapping of both_bad"
            ),
        ),
        (
            "skip: {label: Neither, reasons: {Both bad: Both are bad, cannot_tell: I cannot tell}}",
            (
                "study.yaml:14: conditions[0].skip.reasons.Both bad: expected a mapping of 2 to 4"
                " reasons, each with its text, such as {both_bad: Both are bad,"
                " cannot_tell: I cannot tell}, got the name 'Both bad'"
            ),
        ),
        (
            "skip: {label: Neither, reasons: {both_bad: {ja: どちらも}, cannot_tell: Hm}}",
            (
                "study.yaml:14: conditions[0].skip.reasons.both_bad: expected a text in every"
                " language, got none in en"
            ),
        ),
    ],
)
def test_reasons_that_cannot_be_offered_are_named(
    folder: Path, edit: Edit, faults: Faults, new: str, expected: str
) -> None:
    edit(folder / "study.yaml", "skip: {label: Neither}", new)
    assert expected in faults(folder)


def test_watching_once_is_said_by_true_or_false(folder: Path, edit: Edit, faults: Faults) -> None:
    edit(
        folder / "study.yaml",
        "queries_per_trial: 4",
        "queries_per_trial: 4\nquery: {watch_once: 1}",
    )
    (fault,) = faults(folder)
    assert fault.startswith("study.yaml:20: query.watch_once: expected true or false: whether both")
    assert fault.endswith("got 1")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("{question: {ja: どちら}}", "query.question: expected a text in every language"),
        ("{left: Links}", "query.left: expected words for both buttons, got left without right"),
    ],
)
def test_words_of_the_query_page_that_cannot_be_shown_are_named(
    folder: Path, edit: Edit, faults: Faults, words: str, expected: str
) -> None:
    edit(folder / "study.yaml", "queries_per_trial: 4", f"queries_per_trial: 4\nquery: {words}")
    assert expected in "\n".join(faults(folder))
