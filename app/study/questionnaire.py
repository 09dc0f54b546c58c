"""Questionnaires after a trial and at the end: their items, and validation of answers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt, StrictStr, StringConstraints

from . import numbers
from .numbers import Doubtful
from .parsed_plan import Inconsistency, Place, all_languages, as_list, as_mapping, repeats
from .plan_model import ONE_OR_MORE_TEXTS, LocalText, Part, absent
from .typed_text import typed_length, with_line_feeds

DEFAULT_POINTS = 5
#: Of a text answer, as browsers count it.
LONGEST_TEXT = 2_000

#: What only items of one type may say.
_OF_TYPE = {
    "points": "likert",
    "labels": "likert",
    "min": "number",
    "max": "number",
    "choices": "choice",
}
TYPES = ("likert", "number", "text", "choice")
FEWEST_CHOICES, MOST_CHOICES = 2, 20

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]


ChoiceName = Annotated[StrictStr, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_]{0,39}$")]


class Item(Part):
    """One question."""

    name: StrictStr = Field(
        pattern=r"^[a-z][a-z0-9_]{0,59}$",
        description="a name of lower-case letters, digits and underscores such as how_tired",
    )
    type: Literal["likert", "number", "text", "choice"] = Field(
        description="likert, number, text or choice"
    )
    label: LocalText = Field(description=ONE_OR_MORE_TEXTS)
    required: StrictBool = Field(default=True, description="true or false")
    points: StrictInt | None = Field(
        default=None, ge=2, le=11, description="a whole number of points from 2 to 11"
    )
    labels: tuple[LocalText, ...] | None = Field(
        default=None, description="a list of two labels, for the ends, or one for each point"
    )
    # Left out of a plan's data where not given, so that the hashes of earlier plans stay valid.
    choices: dict[ChoiceName, LocalText] | None = Field(
        default=None,
        min_length=FEWEST_CHOICES,
        max_length=MOST_CHOICES,
        exclude_if=absent,
        description=f"a mapping of {FEWEST_CHOICES} to {MOST_CHOICES} names to choose from, each"
        " with its text, such as {left: Left hand, right: Right hand}",
    )
    min: Finite | None = Field(default=None, description="the smallest number that may be given")
    max: Finite | None = Field(default=None, description="the largest number that may be given")

    @property
    def scale(self) -> int:
        """How many points a likert item has."""
        return self.points or DEFAULT_POINTS


class Questionnaires(Part):
    """The questionnaires of a study."""

    after_trial: tuple[Item, ...] = Field(
        default=(), max_length=20, description="a list of up to 20 items"
    )
    end: tuple[Item, ...] = Field(default=(), max_length=20, description="a list of up to 20 items")


@dataclass(frozen=True)
class AnswerFault:
    """What is wrong with one answer.

    kind: missing, likert, number, text, choice or unknown; or doubtful, an ambiguous number that
    could be any of `readings`, each in ASCII with a point.
    """

    item: str
    kind: str
    message: str
    readings: tuple[str, ...] = ()


def as_meant(typed: str, meant: str | None) -> str | Decimal:
    """The typed text, or the reading of it that its writer has chosen, if it has that reading."""
    number = numbers.read(typed)
    if isinstance(number, Doubtful):
        for reading in number.readings:
            if numbers.plain(reading) == meant:
                return reading
    return typed


def read_answers(
    items: Sequence[Item], answers: Mapping[str, object]
) -> tuple[dict[str, str | None], list[AnswerFault]]:
    """Each item's answer as it is stored (None: not answered), and every fault."""
    values: dict[str, str | None] = {}
    faults = [
        AnswerFault(name, "unknown", f"expected an answer to an item asked here, got {name!r}")
        for name in answers.keys() - {item.name for item in items}
    ]
    for item in items:
        given = answers.get(item.name)
        given = given.strip() if isinstance(given, str) else given
        if given is None or given == "":
            values[item.name] = None
            if item.required:
                faults.append(AnswerFault(item.name, "missing", "expected an answer, got none"))
            continue
        value = _read(item, given)
        values[item.name] = None if isinstance(value, Doubtful) else value
        shown = repr(given)[:60]
        if isinstance(value, Doubtful):
            meant = tuple(map(numbers.plain, value.readings))
            message = (
                f"expected a number that can be read in one way, got {shown}:"
                f" is {numbers.said(value)} meant? A JSON number needs no question"
            )
            faults.append(AnswerFault(item.name, "doubtful", message, meant))
        elif value is None:
            message = f"expected {_expected(item)}, got {shown}"
            faults.append(AnswerFault(item.name, item.type, message))
    return values, faults


def _read(item: Item, given: object) -> str | Doubtful | None:
    """The answer as text; what it could mean, where that is to be asked; or None."""
    if item.type == "text":
        if not isinstance(given, str) or typed_length(given) > LONGEST_TEXT or "\0" in given:
            return None
        return with_line_feeds(given)
    if item.type == "choice":
        return given if isinstance(given, str) and given in (item.choices or {}) else None
    number = _number(given)
    if isinstance(number, Doubtful):
        possible = tuple(one for one in number.readings if _takes(item, one))
        return Doubtful(possible) if possible else None
    return None if number is None or not _takes(item, number) else numbers.plain(number)


def _takes(item: Item, number: Decimal) -> bool:
    if item.type == "likert":
        return number == int(number) and 1 <= number <= item.scale
    return (item.min is None or number >= Decimal(repr(item.min))) and (
        item.max is None or number <= Decimal(repr(item.max))
    )


def _expected(item: Item) -> str:
    if item.type == "text":
        return f"a text of up to {LONGEST_TEXT} characters"
    if item.type == "choice":
        return f"one of {', '.join(item.choices or {})}"
    return f"a whole number from 1 to {item.scale}" if item.type == "likert" else number_range(item)


def number_range(item: Item) -> str:
    """The numbers that an item accepts, in words."""
    if item.min is not None and item.max is not None:
        return f"a number from {item.min:.15g} to {item.max:.15g}"
    if item.min is not None:
        return f"a number of at least {item.min:.15g}"
    return "a number" if item.max is None else f"a number of at most {item.max:.15g}"


def _number(given: object) -> Decimal | Doubtful | None:
    """A number, or text that says one; a comma may stand for the decimal point."""
    if isinstance(given, str):
        return numbers.read(given)
    if isinstance(given, Decimal):
        return given
    if isinstance(given, bool) or not isinstance(given, int | float):
        return None
    return numbers.read(repr(float(given)) if isinstance(given, float) else str(given))


def item_inconsistencies(
    plan: Mapping[str, object], languages: list[object]
) -> Iterator[Inconsistency]:
    """Disagreements within the questionnaires of a plan, given as plain data."""
    for when, listed in as_mapping(plan.get("questionnaires")).items():
        items = [as_mapping(item) for item in as_list(listed)]
        for found in repeats(when, [item.get("name") for item in items], "name"):
            yield Inconsistency(("questionnaires", *found.place), found.message)
        for index, item in enumerate(items):
            yield from _item(("questionnaires", when, index), item, languages)


def _item(
    place: Place, item: Mapping[str, object], languages: list[object]
) -> Iterator[Inconsistency]:
    kind = item.get("type")
    for key, its_type in _OF_TYPE.items():
        if item.get(key) is not None and kind in TYPES and kind != its_type:
            message = f"expected {key} for type {its_type} only, got it for type {kind}"
            yield Inconsistency((*place, key), message)
    yield from all_languages((*place, "label"), item.get("label"), languages)
    choices = item.get("choices")
    if kind == "choice" and choices is None:
        yield Inconsistency((*place, "choices"), "expected choices for type choice, got none")
    for name, text in as_mapping(choices).items():
        yield from all_languages((*place, "choices", name), text, languages)
    labels, points = as_list(item.get("labels")), item.get("points")
    points = points if isinstance(points, int) else DEFAULT_POINTS
    if kind == "likert" and labels and len(labels) not in (2, points):
        message = f"expected 2 labels, for the ends, or {points}, got {len(labels)}"
        yield Inconsistency((*place, "labels"), message)
    for index, label in enumerate(labels):
        yield from all_languages((*place, "labels", index), label, languages)
    low, high = item.get("min"), item.get("max")
    if isinstance(low, int | float) and isinstance(high, int | float) and low > high:
        yield Inconsistency((*place, "max"), f"expected at least min ({low}), got {high}")
