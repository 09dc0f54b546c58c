"""Texts that people type into a form: their line breaks, and their length as browsers count it.

HTML (living standard, 4.10.18.3): `maxlength` counts UTF-16 code units, and a line break as one. A
form is sent with each line break as CR LF.
"""

from __future__ import annotations


def with_line_feeds(text: str) -> str:
    r"""The text with each line break (CR LF, CR or LF) as `\n`, as it stands in the field."""
    return text.replace("\r\n", "\n").replace("\r", "\n")


def typed_length(text: str) -> int:
    """UTF-16 code units of the text, a line break counted once: most emoji count two."""
    text = with_line_feeds(text)
    return len(text) + sum(character > "\uffff" for character in text)
