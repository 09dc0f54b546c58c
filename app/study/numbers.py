"""Parses a number typed by a person; it is accepted only if it is unambiguous.

A comma or a point before the decimals is a decimal mark, unless it could also separate thousands:
`50,000` and `1.000` are returned as Doubtful with each possible value. So are groups of digits and
a percent sign. Digits, signs and marks of other scripts are converted to ASCII.
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from decimal import Context, Decimal
from typing import Final

#: The longest text, in characters, that is read as a number.
LONGEST: Final = 60
_EXACT: Final = Context(prec=2 * LONGEST)

#: Signs and marks that another keyboard types, by what they mean everywhere.
_SAME: Final = str.maketrans(
    {
        **dict.fromkeys("\u2212\ufe63\uff0d\u2010\u2011\u2012\u2013", "-"),
        **dict.fromkeys("\ufe62\uff0b", "+"),
        **dict.fromkeys("\uff0e", "."),
        **dict.fromkeys("\uff0c\ufe50", ","),
        **dict.fromkeys("\uff05\ufe6a\u066a", "%"),
        **dict.fromkeys("\u2019\u02bc\uff07\u066c", "'"),
        **dict.fromkeys("\u00a0\u202f\u2009\u2007\u3000", " "),
    }
)
_ARABIC_DECIMAL_MARK: Final = "\u066b"
_WITH_A_POINT: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
#: Up to three digits that no zero leads, and three after one mark.
_DECIMALS_OR_THOUSANDS: Final = re.compile(r"([+-]?[1-9][0-9]{0,2})([.,])([0-9]{3})")
_GROUPS: Final = re.compile(
    r"([+-]?[1-9][0-9]{0,2}(?P<group>[., '_])[0-9]{3}(?:(?P=group)[0-9]{3})*)"
    r"(?:(?!(?P=group))[.,]([0-9]+))?"
)


@dataclass(frozen=True)
class Doubtful:
    """The possible values of an ambiguous text, one or more, from which a person has to choose."""

    readings: tuple[Decimal, ...]


def read(typed: str) -> Decimal | Doubtful | None:
    """The number in the text; Doubtful if it is ambiguous; None if it is no number."""
    text = _in_ascii(typed.strip())
    if text is None or len(text) > LONGEST:
        return None
    if text.endswith("%"):
        of = read(text[:-1])
        return Doubtful((of, of / 100)) if isinstance(of, Decimal) else None
    if text.count(_ARABIC_DECIMAL_MARK) == 1:
        return _exact(text.replace(_ARABIC_DECIMAL_MARK, "."))
    doubtful = _DECIMALS_OR_THOUSANDS.fullmatch(text)
    if doubtful is not None:
        whole, _, rest = doubtful.groups()
        return Doubtful((Decimal(whole + rest), Decimal(f"{whole}.{rest}")))
    grouped = _GROUPS.fullmatch(text)
    if grouped is not None:
        digits = re.sub(r"[^0-9+-]", "", grouped[1])
        return Doubtful((Decimal(f"{digits}.{grouped[3] or 0}"),))
    return _exact(text.replace(",", ".") if text.count(",") == 1 and "." not in text else text)


def read_with_point(typed: str) -> Decimal | None:
    """The number in a text whose point is known to be a decimal mark; None if it is no number."""
    text = _in_ascii(typed.strip())
    return None if text is None or len(text) > LONGEST else _exact(text)


def plain(number: Decimal) -> str:
    """The exact number in ASCII with a decimal point and without superfluous zeros."""
    short = number.normalize(_EXACT)
    if short == 0:
        return "0"
    return format(short, "f") if -LONGEST < short.adjusted() < LONGEST else str(short)


def said(doubtful: Doubtful) -> str:
    """The possible values as words: 50000 or 50."""
    return " or ".join(plain(reading) for reading in doubtful.readings)


def _exact(text: str) -> Decimal | None:
    """The number written with a point, or None if it exceeds the range of a float."""
    if not _WITH_A_POINT.fullmatch(text):
        return None
    number = Decimal(text)
    is_held = math.isfinite(float(number)) and (number == 0) == (float(number) == 0.0)
    return number if is_held else None


def _in_ascii(text: str) -> str | None:
    """The text with digits and marks of every script in ASCII; None if it has other letters."""
    same = "".join(
        str(unicodedata.decimal(character)) if character.isdecimal() else character
        for character in text.translate(_SAME)
    )
    return same if same.replace(_ARABIC_DECIMAL_MARK, "").isascii() else None
