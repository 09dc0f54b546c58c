"""Values of a link's parameters: which of them name a person or a submission, and which name none.

A value is read as its platform means it: white space around it and invisible characters are no part
of it, and a parameter has its name in any case. What a platform or a survey tool has left unfilled,
such as `{{%PROLIFIC_PID%}}`, stands for nobody: two people who bring it are two people.
"""

from __future__ import annotations

import html
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from urllib.parse import unquote

#: Longer than any id of a platform, and than any address in Mechanical Turk's links.
LONGEST_ID = 200
#: How often a value may have been encoded on its way: by a tool, by a mail program, by a redirect.
_MOST_ENCODINGS = 4

#: Shown as nothing, though Unicode calls them letters or marks.
_BLANK = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0") | {
    chr(code) for code in (*range(0x180B, 0x1810), *range(0xFE00, 0xFE10))
}
_NOTHING = """
undefined null nil none nan na void empty blank missing unknown unset default anonymous guest
true false object objectobject test testing tester testid testuser testpid testparticipant
testworker example sample dummy demo preview placeholder assignmentidnotavailable
id pid uid rid value string yourid youridhere participant user username
"""
_PARAMETERS = """
prolificpid prolificid studyid sessionid participantid assignmentid projectid workerid hitid
turksubmitto surveycode subjectid submissionid respondentid responseid userid
"""
#: What programs and people write where there is no value.
_WORDS = frozenset(_NOTHING.split())
#: Names that tools put in place of the value, besides those of the parameters themselves.
_NAMES = frozenset(_PARAMETERS.split())
#: No platform's ids have these; templates of every tool do.
_TEMPLATE = re.compile(r"[{}<>\[\]\ufffd]|\$\(|^\$|^%[^%]*%$|^__.*__$|^([#*@~|!?:^]).*\1$")


@dataclass(frozen=True)
class Given:
    """What a request says of its person: values by the plan's own names of the parameters.

    unfilled: names of parameters that came with a value that stands for nobody.
    """

    ids: Mapping[str, str]
    unfilled: tuple[str, ...] = ()


class UnreadableIdError(ValueError):
    """A parameter that names nobody for certain; `parameter` is its name."""

    def __init__(self, parameter: str, message: str) -> None:
        super().__init__(f"{parameter}: {message}")
        self.parameter = parameter


def read(names: Iterable[str], came: Iterable[tuple[str, str]]) -> Given:
    """The values of these parameters among those that came.

    Raises UnreadableIdError where one came twice with different values, is too long, or has
    characters that no id has.
    """
    wanted = {name.casefold(): name for name in names}
    ids: dict[str, str] = {}
    unfilled: list[str] = []
    for given, raw in came:
        name = wanted.get(clean(given).casefold())
        if name is None:
            continue
        value = clean(raw)
        if stands_for_nobody(value, name):
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
    """The value without white space around it, and without characters that nobody sees."""
    seen = "".join(
        letter for letter in value if unicodedata.category(letter) != "Cf" and letter not in _BLANK
    )
    return seen.strip().strip("\0").strip()


def stands_for_nobody(value: str, name: str = "") -> bool:
    """Whether the value of the parameter `name` is none: unfilled, blank, or a word for nothing."""
    for _ in range(_MOST_ENCODINGS):
        value = clean(unicodedata.normalize("NFKC", value))
        if _is_none(value, name):
            return True
        decoded = html.unescape(unquote(value))
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
        letters in _WORDS
        or letters in _NAMES
        or letters == own_name
        # Zeros alone, and what SONA and Typeform show in place of a code.
        or set(letters) == {"0"}
        or (len(letters) > 1 and set(letters) == {"x"})
    )
