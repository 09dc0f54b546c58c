"""What a person would ask before a study is opened, although nothing in it is a fault."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

from .page_words import WORDS, spoken_locale
from .plan import Plan
from .plan_source import STUDY_FILE
from .recordings import RecordingRow
from .table_headers import VIDEO_ENDINGS
from .validation_errors import Fault

#: The longest video lasts so many times the shortest.
LENGTHS_DIFFER: Final = 1.5
#: Numbers that differ by less, of their size, are the same as far as anybody can tell.
NEARLY_EQUAL: Final = 1e-9
_PAIRS: Final = re.compile(
    r"\b([0-9]{1,4})\s*(?:pairs?|Paare?n?|paires?|pares|組)(?![^\W\d_])", re.IGNORECASE
)

#: The number of random queries that a condition's settings ask for.
RandomQueries = Callable[[Mapping[str, Any]], int]


def doubts(
    plan: Plan,
    texts: Mapping[str, Mapping[str, str]],
    recordings: Sequence[RecordingRow],
    unused: Sequence[str],
    random_queries: RandomQueries,
) -> list[Fault]:
    """The doubts about a valid study, each with the file that it is about.

    texts: language -> name -> text. recordings: the rows of its tables. unused: files that no part
    of the study names.
    """
    used = [row for row in recordings if row.environment in plan.used_environments]
    return [
        *_on_design(plan, random_queries),
        *_on_languages(plan, texts),
        *_on_texts(plan, texts),
        *_on_candidates(plan, used),
        *_on_videos(used, unused),
    ]


def _on_design(plan: Plan, random_queries: RandomQueries) -> Iterator[Fault]:
    for condition in plan.conditions:
        if condition.method == "knockout":
            continue
        number = random_queries(condition.settings)
        if plan.queries_per_trial <= number:
            yield Fault(
                STUDY_FILE,
                None,
                f"condition {condition.name}: the method never chooses a pair, since the first"
                f" {number} answers are to random pairs and a trial has {plan.queries_per_trial}",
            )
    for name in plan.environments:
        if name not in plan.used_environments:
            yield Fault(STUDY_FILE, None, f"no condition uses the environment {name}")


def _on_languages(plan: Plan, texts: Mapping[str, Mapping[str, str]]) -> Iterator[Fault]:
    for language in plan.languages:
        if spoken_locale(language) is None and WORDS not in texts.get(language, {}):
            yield Fault(
                STUDY_FILE,
                None,
                f"buttons, notices and the privacy page are in English where the study is in"
                f" {language}: the studio has no translation of them",
            )


def _on_texts(plan: Plan, texts: Mapping[str, Mapping[str, str]]) -> Iterator[Fault]:
    right = {
        plan.queries_per_trial,
        plan.shown_per_trial,
        plan.trials * plan.shown_per_trial,
        plan.trials * plan.queries_per_trial,
        plan.practice.queries,
    }
    for language, named in texts.items():
        for name, text in named.items():
            if name == WORDS:
                continue
            file = f"texts/{language}/{name}.md"
            for number, line in enumerate(text.splitlines(), start=1):
                for found in _PAIRS.finditer(line):
                    if int(found[1]) not in right:
                        message = f"it says '{found[0]}', and a trial has {plan.shown_per_trial}"
                        yield Fault(file, number, message)
            words = [line for line in text.splitlines() if line.strip() and line.strip()[0] != "#"]
            if not words:
                yield Fault(file, None, "it has a heading and no text")


def _on_candidates(plan: Plan, rows: Sequence[RecordingRow]) -> Iterator[Fault]:
    for environment in dict.fromkeys(row.environment for row in rows):
        source = plan.environments[environment].source
        own = [row for row in rows if row.environment == environment]
        for place, parameter in enumerate(plan.parameters):
            values = {row.candidate[place] for row in own}
            if len(values) == 1:
                message = f"{parameter.name} is {next(iter(values))} in every row: it has no effect"
                yield Fault(source, None, message)
            numbers = sorted(value for value in values if isinstance(value, float))
            for a, b in pairwise(numbers):
                if math.isclose(a, b, rel_tol=NEARLY_EQUAL):
                    message = f"{parameter.name} has the values {a!r} and {b!r}: is one meant?"
                    yield Fault(source, None, message, "nearly equal")
        scored = sum(row.score is not None for row in own)
        if 0 < scored < len(own):
            yield Fault(source, None, f"{scored} of {len(own)} rows have a score")


def _on_videos(rows: Sequence[RecordingRow], unused: Sequence[str]) -> Iterator[Fault]:
    if rows:
        longest = max(rows, key=lambda row: row.duration_s)
        shortest = min(rows, key=lambda row: row.duration_s)
        if longest.duration_s > LENGTHS_DIFFER * shortest.duration_s:
            yield Fault(
                shortest.file,
                None,
                f"it lasts {shortest.duration_s:.2g} s and {longest.file} lasts"
                f" {longest.duration_s:.2g} s: the shorter of a pair waits for the longer",
            )
    left = [name for name in unused if name.lower().endswith(VIDEO_ENDINGS)]
    if left:
        one = len(left) == 1
        message = f"{len(left)} video{'' if one else 's'} {'is' if one else 'are'} in no table"
        yield Fault(left[0], None, message)
