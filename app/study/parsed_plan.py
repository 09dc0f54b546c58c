"""A plan as plain data, for validation across its fields.

Missing values and values of a wrong type are skipped here: the fields' own rules report them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

Place = tuple[str | int, ...]


@dataclass(frozen=True)
class Inconsistency:
    """A value that contradicts the rest of the plan, and its place."""

    place: Place
    message: str

    def __str__(self) -> str:
        return f"{path_text(self.place)}: {self.message}"


def path_text(place: Place) -> str:
    """A place in readable form: `conditions[1].skip.label`."""
    text = ""
    for step in place:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def all_languages(place: Place, text: object, languages: list[object]) -> Iterator[Inconsistency]:
    """Inconsistencies of a text that lacks a language of the study or has another one."""
    if isinstance(text, str):
        given = set(languages[:1])
    elif isinstance(text, Mapping):
        given = set(text)
    else:
        return
    missing = [str(language) for language in languages if language not in given]
    if missing:
        message = f"expected a text in every language, got none in {', '.join(missing)}"
        yield Inconsistency(place, message)
    for language in given.difference(languages):
        known = ", ".join(map(str, languages))
        message = f"expected one of the study's languages ({known}), got {language!r}"
        yield Inconsistency((*place, str(language)), message)


def repeats(section: str, values: list[object], key: str | None = None) -> Iterator[Inconsistency]:
    """An inconsistency for each value of the section that occurs again."""
    first: dict[str, int] = {}
    for index, value in enumerate(values):
        if not isinstance(value, str):
            continue
        if value in first:
            place: Place = (section, index) if key is None else (section, index, key)
            as_at = f"{section}[{first[value]}]"
            message = f"expected each once, got {value!r} again (as at {as_at})"
            yield Inconsistency(place, message)
        first.setdefault(value, index)


def languages_of(plan: Mapping[str, object]) -> list[object]:
    """The languages of the plan that are strings."""
    return [language for language in as_list(plan.get("languages")) if isinstance(language, str)]


def as_mapping(value: object) -> Mapping[str, object]:
    """The value with string keys if it is a mapping; else empty."""
    return {str(key): inner for key, inner in value.items()} if isinstance(value, Mapping) else {}


def as_list(value: object) -> list[object]:
    """The value as a list if it is a list or tuple; else empty."""
    return list(value) if isinstance(value, list | tuple) else []
