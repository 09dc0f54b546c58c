"""Reads identifiers from a link's parameters, and recognises values that identify no one.

White space around a value and invisible characters are ignored, and names of parameters are
case-insensitive. A placeholder that a platform or survey tool left unfilled, such as
`{{%PROLIFIC_PID%}}`, identifies no one: two people with the same placeholder are two people.
"""

from __future__ import annotations

import html
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from urllib.parse import unquote

#: The longest value; ids of platforms and addresses in Mechanical Turk's links are shorter.
LONGEST_ID = 200
#: How often a value may be encoded: by a tool, a mail program, a redirect.
_MOST_ENCODINGS = 20
#: Escapes of JavaScript and JSON, and the quoted-printable ones of mail.
_ESCAPES = re.compile(r"(?:%u|\\u|\\x|=)([0-9A-Fa-f]{4}|[0-9A-Fa-f]{2})", re.ASCII)

#: Shown as nothing, though Unicode calls them letters or marks.
_BLANK = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0") | {
    chr(code) for code in (*range(0x180B, 0x1810), *range(0xFE00, 0xFE10))
}
#: Words for a missing value or in place of one, as programs and people write them. A value that is
#: made of such words alone, such as `not available` or `YOUR_ID_HERE`, identifies no one.
_WORDS_OF_NO_ONE = """
undefined null nil none nonetype nan void empty blank missing unknown unset unfilled default
anonymous guest true false object error deleted unavailable invalid tbd todo ref
not no answer available applicable provided specified given set found value string
test testing tester example sample dummy demo preview placeholder
your my the enter insert put paste here
id ids pid uid rid lsid number code name token key email
prolific sona mturk connect cloudresearch qualtrics worker participant subject user username
respondent panelist response submission assignment study session survey project transaction
hit external turksubmitto
unbekannt keine keiner leer ohne inconnu aucun vide desconocido ninguno
なし 無し 不明 未設定 未入力 未定 未回答 テスト 匿名
"""
_WORDS = frozenset(_WORDS_OF_NO_ONE.split())
_LONGEST_WORD = max(map(len, _WORDS))
#: Characters of placeholders, which no platform's ids contain.
_TEMPLATE = re.compile(r"[{}<>\[\]\ufffd]|\$\(|^\$|^%[^%]*%$|^%[a-z]$|^__.*__$|^([#*@~|!?:^]).*\1$")


@dataclass(frozen=True)
class Given:
    """Identifiers of a request, by the plan's names of the parameters.

    unfilled: names of parameters whose value is a placeholder.
    """

    ids: Mapping[str, str]
    unfilled: tuple[str, ...] = ()


class UnreadableIdError(ValueError):
    """A parameter without one clear value; `parameter` is its name."""

    def __init__(self, parameter: str, message: str) -> None:
        super().__init__(f"{parameter}: {message}")
        self.parameter = parameter


def read(names: Iterable[str], came: Iterable[tuple[str, str]]) -> Given:
    """The values of these parameters among those of the request.

    Raises UnreadableIdError for a parameter with two different values, one that is too long, or one
    with characters that no id has.
    """
    wanted = {name.casefold(): name for name in names}
    ids: dict[str, str] = {}
    unfilled: list[str] = []
    for given, raw in came:
        name = wanted.get(clean(given).casefold())
        if name is None:
            continue
        value = clean(raw)
        if identifies_no_one(value, name):
            unfilled.append(name)
            continue
        if len(value) > LONGEST_ID:
            raise UnreadableIdError(
                name, f"expected at most {LONGEST_ID} characters, got {len(value)}"
            )
        if any(unicodedata.category(letter) in ("Cc", "Cs") for letter in value):
            raise UnreadableIdError(name, "expected text, got control characters")
        if ids.setdefault(name, value) != value:
            raise UnreadableIdError(name, "expected one value, got two that differ")
    return Given(ids, tuple(dict.fromkeys(name for name in unfilled if name not in ids)))


def clean(value: str) -> str:
    """The value without surrounding white space and without invisible characters."""
    seen = "".join(
        letter for letter in value if unicodedata.category(letter) != "Cf" and letter not in _BLANK
    )
    return seen.strip().strip("\0").strip()


def identifies_no_one(value: str, name: str = "") -> bool:
    """Whether the value of the parameter `name` is unfilled, blank, or a word for nothing."""
    for _ in range(_MOST_ENCODINGS):
        value = clean(unicodedata.normalize("NFKC", value))
        if _is_none(value, name):
            return True
        decoded = html.unescape(_ESCAPES.sub(_unescaped, unquote(value)))
        if decoded == value:
            return False
        value = decoded
    return False


def _is_none(value: str, name: str) -> bool:
    letters = "".join(filter(str.isalnum, value)).casefold()
    if not letters or _TEMPLATE.search(value):
        return True
    own_name = "".join(filter(str.isalnum, name)).casefold()
    return (
        letters == "na"
        or _is_of_words(letters)
        or letters == own_name
        # Zeros alone, and what SONA and Typeform show in place of a code.
        or set(letters) == {"0"}
        or (len(letters) > 1 and set(letters) == {"x"})
    )


def _is_of_words(letters: str) -> bool:
    """Whether the letters are words of `_WORDS` one after the other."""
    if len(letters) > LONGEST_ID:
        return False
    reached = [0]
    for end in range(1, len(letters) + 1):
        starts = (start for start in reached if end - start <= _LONGEST_WORD)
        if any(letters[start:end] in _WORDS for start in starts):
            reached.append(end)
    return reached[-1] == len(letters)


def _unescaped(escape: re.Match[str]) -> str:
    return chr(int(escape[1], 16))
