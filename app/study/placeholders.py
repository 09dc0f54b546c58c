"""Placeholders in a study's texts: those of the example, and values of the plan.

`[your names and institution]` of the example is to be replaced by the study's own words; any other
words in brackets are text. `{{ queries_per_trial }}` is filled in from the plan.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final

from .plan import Plan
from .scaffold import EXAMPLE

_BRACKETS: Final = re.compile(r"\[[^\]\[]+\](?![(\[:])")
_VALUE: Final = re.compile(r"\{\{ *([A-Za-z_][A-Za-z0-9_]*) *\}\}")
#: What texts can name of the plan.
VALUES: Final = (
    "queries_per_trial",
    "trials",
    "pairs_per_session",
    "practice_queries",
    "familiarisation_videos",
    "break_s",
)


@cache
def of_example() -> frozenset[str]:
    """The words in brackets that stand in the example's texts."""
    texts = (path.read_text(encoding="utf-8") for path in (EXAMPLE / "texts").rglob("*.md"))
    return frozenset(found for text in texts for found in _BRACKETS.findall(text))


def placeholders(markdown: str) -> list[tuple[int, str]]:
    """The example's placeholders that remain in a text: line number, from 1, and placeholder."""
    return [
        (number, found)
        for number, line in enumerate(markdown.splitlines(), start=1)
        for found in _BRACKETS.findall(line)
        if found in of_example()
    ]


def unknown_values(markdown: str) -> Iterator[tuple[int, str]]:
    """The values in double braces that no plan has: line number, from 1, and name."""
    for number, line in enumerate(markdown.splitlines(), start=1):
        for found in _VALUE.finditer(line):
            if found[1] not in VALUES:
                yield number, found[1]


def filled(markdown: str, plan: Plan) -> str:
    """The text with the plan's values in place of `{{ name }}`."""
    values: Mapping[str, int] = {
        # Counted as evaluators see them: with the checks between the queries.
        "queries_per_trial": plan.shown_per_trial,
        "trials": plan.trials,
        "pairs_per_session": plan.trials * plan.shown_per_trial,
        "practice_queries": plan.practice.queries,
        "familiarisation_videos": plan.familiarisation.videos,
        "break_s": plan.break_s,
    }
    return _VALUE.sub(lambda found: str(values.get(found[1], found[0])), markdown)
