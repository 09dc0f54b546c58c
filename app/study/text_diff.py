"""The difference between two texts, line by line."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

#: Lines of either text that are compared: the time that it takes grows with their product.
MOST_LINES = 3_000
_AROUND = 2


@dataclass(frozen=True)
class Line:
    """One line: sign is `-` for one of the first text alone, `+` of the second, ` ` of both."""

    sign: str
    text: str


def text_hash(text: str) -> str:
    """A hash in a form that identifies the text from which it was filled."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:32]


def difference(theirs: str, yours: str) -> list[Line]:
    """The lines that differ, with two lines of context each; `…` stands for omitted lines."""
    first, second = theirs.splitlines(), yours.splitlines()
    if max(len(first), len(second)) > MOST_LINES:
        return [Line(" ", f"… more than {MOST_LINES:,} lines: they are not compared")]
    return list(_lines(first, second))


def _lines(first: list[str], second: list[str]) -> Iterator[Line]:
    matcher = difflib.SequenceMatcher(None, first, second, autojunk=False)
    for number, group in enumerate(matcher.get_grouped_opcodes(_AROUND)):
        if number:
            yield Line(" ", "…")
        for what, a, b, c, d in group:
            if what == "equal":
                yield from (Line(" ", line) for line in first[a:b])
                continue
            yield from (Line("-", line) for line in first[a:b])
            yield from (Line("+", line) for line in second[c:d])
