"""Bounds on the size of error responses: few faults, short names, short values."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Any

from app.study.shortening import shortened

#: How many faults one refusal names; it counts the others.
MOST_FAULTS = 20
#: The longest name or message of one fault in a list, in bytes of JSON.
_LONGEST_PART = 140
#: The longest list of faults in one sentence, in bytes of JSON.
_LONGEST_SENTENCE = 800


def bounded(value: Any) -> Any:
    """A part of an error response: at most `MOST_FAULTS` entries per list, and short texts."""
    if isinstance(value, str):
        # JSON can bring half of a surrogate pair, which no encoding can write.
        return shortened(value, _LONGEST_PART).encode("utf-8", "replace").decode()
    if isinstance(value, dict):
        entries = islice(value.items(), MOST_FAULTS)
        return {bounded(name): bounded(part) for name, part in entries}
    if isinstance(value, list | tuple):
        return [bounded(part) for part in value[:MOST_FAULTS]]
    return value


def sentence(messages: Iterable[str]) -> str:
    """The first messages in one sentence, and how many more there are."""
    every = list(messages)
    said: list[str] = []
    for message in every[:MOST_FAULTS]:
        if said and sum(map(len, said)) + len(message) > _LONGEST_SENTENCE:
            break
        said.append(message)
    left_out = len(every) - len(said)
    told = shortened("; ".join(said), _LONGEST_SENTENCE)
    return f"{told}; and {left_out:,} more" if left_out else told
