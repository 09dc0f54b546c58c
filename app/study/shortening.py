"""Shortens long texts, so that a message stays small whatever it quotes."""

from __future__ import annotations

import json

#: The longest message of one fault, in bytes of JSON.
LONGEST_MESSAGE = 1_000


def shortened(text: str, most: int = LONGEST_MESSAGE) -> str:
    """The text, or its beginning and its length where it takes more than `most` bytes of JSON."""
    beginning = text[:most]
    while _size(beginning) > most:
        beginning = beginning[: len(beginning) * 3 // 4]
    if beginning == text:
        return text
    return f"{beginning}… ({len(text):,} characters)"


def quoted(text: str) -> str:
    """The text in quotes; escaped, as in Python, only if it has letters that cannot be seen."""
    return f"'{text}'" if text.isprintable() and "'" not in text else repr(text)


def _size(text: str) -> int:
    """How many bytes the text takes in JSON, where a control character takes six."""
    return len(json.dumps(text, ensure_ascii=False).encode("utf-8", "replace")) - 2
