"""Values of a plan as the texts of form fields, and what was typed as values of a plan."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from typing import Any, Final

from ruamel.yaml.comments import CommentedMap

from . import numbers
from .parsed_plan import as_mapping
from .yaml_edit import remove_key, set_key

Fields = Mapping[str, str]

#: What no field takes.
MOST_TYPED: Final = 10**13


def said_of(value: object) -> str:
    """The text of a field that holds this value; empty for None."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else str(value)


def text_of(value: object, language: str, languages: list[str]) -> str:
    """The text in this language; one text alone is in the first."""
    if isinstance(value, str):
        return value if language == languages[0] else ""
    return said_of(as_mapping(value).get(language))


def texts_of(
    given: Fields, prefix: str, languages: list[str], old_languages: list[str]
) -> str | dict[str, str]:
    """A text in each language that has one; the plain text in a study of one language."""
    texts = {}
    for place, language in enumerate(languages):
        # The first language renamed: its texts stay those of the first language.
        was = old_languages[0] if place == 0 and old_languages else language
        text = given.get(f"{prefix}:{language}", given.get(f"{prefix}:{was}", "")).strip()
        if text:
            texts[language] = text
    return texts.get(languages[0], "") if len(languages) == 1 else texts


def value_of(typed: str, *, whole: bool = False, least: int = -MOST_TYPED) -> object:
    """The number that was typed; None if the field is empty.

    What is no number, is ambiguous, below `least`, or a fraction where a whole number belongs stays
    the typed text, which the validation reports.
    """
    typed = typed.strip()
    number = numbers.read(typed)
    if not isinstance(number, Decimal) or not least <= number < MOST_TYPED:
        return typed or None
    if number == int(number):
        return int(number)
    return typed if whole else float(number)


def put(data: CommentedMap, key: str, value: Any) -> None:
    """Set a key, or remove it where nothing is left of its value."""
    if value in (None, {}, []):
        remove_key(data, key)
    else:
        set_key(data, key, value)
