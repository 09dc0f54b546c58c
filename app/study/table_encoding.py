"""Finds the encoding of a table, and decodes it.

A byte order mark, the zeros of UTF-16 and valid UTF-8 decide by themselves. Otherwise the names of
existing files decide between the code pages that spreadsheets write, and else the kinds of letters.
"""

from __future__ import annotations

import codecs
import re
import unicodedata
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from .validation_errors import UnreadableFileError

#: Encoding -> what people call it.
NAMES: Final = {
    "utf-8": "UTF-8",
    "utf-16-le": "UTF-16",
    "utf-16-be": "UTF-16",
    "cp932": "Shift-JIS",
    "cp1252": "Windows-1252",
    "mac-roman": "Mac Roman",
}
_CODE_PAGES: Final = ("cp932", "cp1252", "mac-roman")
_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
#: Bytes looked at for the zeros of UTF-16.
_HEAD: Final = 2_000
#: A pair of bytes is seldom two Japanese letters by chance: kana, or two kanji in a row.
_JAPANESE: Final = re.compile("[\u3041-\u30ff]|[\u4e00-\u9fff\u3005]{2}")
#: Letters and signs of western European languages.
_WESTERN: Final = re.compile(
    "[\xa0-\xff\u0152\u0153\u0160\u0161\u0178\u017d\u017e\u2013-\u2026\u20ac]+"
)


@dataclass(frozen=True)
class Decoded:
    """A text and its encoding. has_mark: whether it began with a byte order mark."""

    text: str
    encoding: str
    has_mark: bool = False

    @property
    def name(self) -> str:
        """The encoding's name for people."""
        return NAMES[self.encoding]


def decode(content: bytes, file_names: Collection[str] = ()) -> Decoded:
    """Decode a table. file_names: names of files, without folders, that its cells may hold.

    Raises UnreadableFileError, with the line, if no encoding or more than one is possible.
    """
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            return Decoded(_strictly(content[len(mark) :], encoding), encoding, has_mark=True)
    found = _by_zeros(content[:_HEAD])
    if found is not None:
        return Decoded(_strictly(content, found), found)
    try:
        return Decoded(content.decode("utf-8"), "utf-8")
    except UnicodeDecodeError as error:
        return _by_code_page(content, file_names, error)


def _strictly(content: bytes, encoding: str) -> str:
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        message = f"expected text in {NAMES[encoding]}, got a damaged one: {error.reason}"
        raise UnreadableFileError(message) from error


def _by_zeros(head: bytes) -> str | None:
    """UTF-16 by the zeros that it has at every other place of plain letters."""
    if len(head) < 4 or b"\0" not in head:
        return None
    even, odd = head[0::2].count(0), head[1::2].count(0)
    if odd > 0.4 * len(head) / 2 and even < odd / 4:
        return "utf-16-le"
    if even > 0.4 * len(head) / 2 and odd < even / 4:
        return "utf-16-be"
    return None


def _by_code_page(
    content: bytes, file_names: Collection[str], error: UnicodeDecodeError
) -> Decoded:
    texts = {}
    for encoding in _CODE_PAGES:
        try:
            texts[encoding] = content.decode(encoding)
        except UnicodeDecodeError:
            continue
    wanted = [name for name in map(_normal, file_names) if not name.isascii()]
    counted = {
        encoding: sum(name in text for name in wanted)
        for encoding, text in ((key, _normal(value)) for key, value in texts.items())
    }
    most = max(counted.values(), default=0)
    found = [encoding for encoding, number in counted.items() if number == most]
    if most == 0 or len(found) > 1:
        found = [encoding for encoding in found if _is_plausible(encoding, texts[encoding])]
    if len(found) == 1:
        return Decoded(texts[found[0]], found[0])
    line = content[: error.start].count(b"\n") + 1
    byte = content[error.start]
    message = f"expected text in UTF-8, got the byte 0x{byte:02x}"
    if found:
        message += f", which could be {' or '.join(NAMES[one] for one in found)}"
    raise UnreadableFileError(f"{message}: save it as CSV UTF-8 or as .xlsx", line) from error


def _is_plausible(encoding: str, text: str) -> bool:
    """Whether the letters outside ASCII are those that the code page is used for."""
    if encoding == "cp932":
        return _JAPANESE.search(text) is not None
    others = [letter for letter in text if not letter.isascii()]
    letters = sum(unicodedata.category(letter) in ("Ll", "Lu") for letter in others)
    is_western = _WESTERN.fullmatch("".join(others)) is not None
    # Without names of files, Mac Roman cannot be told from Windows-1252, which is far more common.
    return encoding == "cp1252" and is_western and 2 * letters >= len(others)


def _normal(text: str) -> str:
    return unicodedata.normalize("NFC", text).casefold()
