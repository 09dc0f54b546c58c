"""Settings of the comparisons: skips with their reasons, and the query page."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, StrictBool, StrictInt, StrictStr, StringConstraints

from .parsed_plan import Inconsistency, Place, all_languages, as_mapping, languages_of
from .plan_model import ONE_OR_MORE_TEXTS, LocalText, Part, absent

#: The query page's buttons, and all its words, that a study can choose.
BUTTONS = ("left", "right")
WORDS = ("question", *BUTTONS)
FEWEST_REASONS, MOST_REASONS = 2, 4

#: What a skip says under the paper's methods, whatever its label.
FIXED_MEANING: Mapping[object, str] = MappingProxyType(
    {
        "pbpo": "says that both are bad",
        "pbpo-no-synthesis": "says that the two are equal, and is not learned from",
    }
)

ReasonName = Annotated[StrictStr, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]


class Skip(Part):
    """The skip button. It is required exactly where the method can use a skip."""

    label: LocalText = Field(description=ONE_OR_MORE_TEXTS)
    reasons: dict[ReasonName, LocalText] | None = Field(
        default=None,
        min_length=FEWEST_REASONS,
        max_length=MOST_REASONS,
        description=f"a mapping of {FEWEST_REASONS} to {MOST_REASONS} reasons, each with its text,"
        " such as {both_bad: Both are bad, cannot_tell: I cannot tell}",
    )
    # Left out of a plan's data where not given, so that the hashes of earlier plans stay valid.
    means: Literal["both_bad", "cannot_tell"] | None = Field(
        default=None,
        exclude_if=absent,
        description="both_bad or cannot_tell: what a skip without one of these reasons says",
    )


def draw_reason_order(skips: Iterable[Skip | None], rng: np.random.Generator) -> tuple[str, ...]:
    """The names of all reasons of these skips, each order being as likely as any other."""
    names = list(dict.fromkeys(name for skip in skips if skip for name in skip.reasons or ()))
    return tuple(names[index] for index in rng.permutation(len(names)))


def reasons_in(order: Sequence[str] | None, skip: Skip) -> tuple[str, ...]:
    """The names of the skip's reasons in this order; in the plan's, if there is none."""
    names = tuple(skip.reasons or ())
    places = {name: place for place, name in enumerate(order or ())}
    return tuple(sorted(names, key=lambda name: places.get(name, len(places))))


class QueryPage(Part):
    """How a pair is shown and answered."""

    # Left out of a plan's data where not given, so that the hashes of earlier plans stay valid.
    question: LocalText | None = Field(
        default=None, exclude_if=absent, description=ONE_OR_MORE_TEXTS
    )
    left: LocalText | None = Field(default=None, exclude_if=absent, description=ONE_OR_MORE_TEXTS)
    right: LocalText | None = Field(default=None, exclude_if=absent, description=ONE_OR_MORE_TEXTS)
    watch_once: StrictBool = Field(
        default=False,
        description="true or false: whether both videos have to be seen to their end first",
    )
    undo_s: StrictInt = Field(
        default=0,
        ge=0,
        le=60,
        description="whole seconds from 0 (no undo) to 60 in which a response can be taken back",
    )


def query_inconsistencies(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """Words of the query page that lack a language, and one button's words without the other's."""
    query = as_mapping(plan.get("query"))
    for name in WORDS:
        yield from all_languages(("query", name), query.get(name), languages_of(plan))
    given = [name for name in BUTTONS if query.get(name) is not None]
    if len(given) == 1:
        missing = next(name for name in BUTTONS if name not in given)
        message = f"expected words for both buttons, got {given[0]} without {missing}"
        yield Inconsistency(("query", given[0]), message)


def skip_inconsistencies(
    place: Place, skip: object, method: object, plan: Mapping[str, object]
) -> Iterator[Inconsistency]:
    """Labels of a skip button that lack a language, and a meaning that the method cannot learn."""
    said = as_mapping(skip)
    if said.get("means") is not None and method in FIXED_MEANING:
        message = f"expected no meaning under {method}, where a skip {FIXED_MEANING[method]}"
        yield Inconsistency((*place, "means"), f"{message}; pbpo-threshold learns either")
    yield from all_languages((*place, "label"), said.get("label"), languages_of(plan))
    for name, text in as_mapping(said.get("reasons")).items():
        yield from all_languages((*place, "reasons", name), text, languages_of(plan))
