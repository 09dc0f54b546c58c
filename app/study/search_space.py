"""Parameters, and the search space that their ranges and the constraints between them define.

A study either lists its candidates, as recordings that exist before it opens, or gives each
parameter a range. Then every point within the ranges and constraints is a candidate, and its
recording is made when a query needs it. Constraints are only read here as texts: what they mean is
checked by the caller of `plan_source.read_plan`, which is given the whole space.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field, StrictStr, ValidationError

from .parsed_plan import Inconsistency, Place, as_list, as_mapping
from .plan_model import ONE_OR_MORE_TEXTS, Finite, LocalText, Part, absent

#: More parameters than the responses of one session can say anything about.
MOST_PARAMETERS = 8
MOST_CONSTRAINTS = 50
#: Bounds beyond this are typing errors, and their differences would lose digits.
LARGEST_BOUND = 1e12
#: A range narrower than this share of its bounds holds few different numbers.
NARROWEST_RANGE = 1e-6
LOG = "log"
#: The method that can propose points which are not in a list.
RANGE_METHOD = "pbpo-threshold"
#: What the command of a machine is given beside the parameters.
COMMAND_PLACEHOLDERS = frozenset({"video", "seed", "rollout", "environment", "run_index"})

_BOUND = f"a number between -{LARGEST_BOUND:g} and {LARGEST_BOUND:g}"


class Parameter(Part):
    """One coordinate of a candidate, with its range in a study that has no list of candidates."""

    name: StrictStr = Field(
        pattern=r"^[a-z][a-z0-9_]{0,39}$",
        description="a name of lower-case letters, digits and underscores such as opening_time",
    )
    label: LocalText | None = Field(default=None, description=ONE_OR_MORE_TEXTS)
    unit: StrictStr | None = Field(default=None, description="a unit such as s")
    # Left out of a plan's data where not used, so that the hashes of earlier plans stay valid.
    min: Finite | None = Field(
        default=None,
        ge=-LARGEST_BOUND,
        le=LARGEST_BOUND,
        exclude_if=absent,
        description=_BOUND,
    )
    max: Finite | None = Field(
        default=None,
        ge=-LARGEST_BOUND,
        le=LARGEST_BOUND,
        exclude_if=absent,
        description=_BOUND,
    )
    step: Finite | None = Field(
        default=None, gt=0, exclude_if=absent, description="a number above 0"
    )
    scale: Literal["linear", "log"] = Field(
        default="linear",
        exclude_if=lambda scale: scale == "linear",
        description="linear or log",
    )


@dataclass(frozen=True)
class SearchSpace:
    """Ranges of parameters and the constraints between them, one entry for each parameter.

    low, high: the bounds, which are inside. step: the distance of a parameter's values, counted
    from low, or None for any value. log: whether its scale is logarithmic.
    """

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    step: tuple[float | None, ...]
    log: tuple[bool, ...]
    constraints: tuple[str, ...]


def has_ranges(plan: Mapping[str, object]) -> bool:
    """Whether a parameter of the plan, given as plain data, has a bound."""
    return any(
        parameter.get("min") is not None or parameter.get("max") is not None
        for parameter in _parameters(plan)
    )


def space_inconsistencies(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """All contradictions in the ranges of a plan, and between them and the rest of it."""
    parameters = _parameters(plan)
    if not has_ranges(plan):
        for index, parameter in enumerate(parameters):
            for key in ("step", "scale"):
                if parameter.get(key) not in (None, "linear"):
                    message = f"expected min and max beside {key}, got neither"
                    yield Inconsistency(("parameters", index, key), message)
        if as_list(plan.get("constraints")):
            message = "expected min and max of every parameter beside constraints, got neither"
            yield Inconsistency(("constraints",), message)
        return
    if len(parameters) > MOST_PARAMETERS:
        message = f"expected at most {MOST_PARAMETERS} parameters with ranges"
        yield Inconsistency(("parameters",), f"{message}, got {len(parameters)}")
    for index, parameter in enumerate(parameters):
        yield from _range_inconsistencies(("parameters", index), parameter)
    yield from _what_needs_a_list(plan)


def space_of(plan: Mapping[str, object]) -> SearchSpace | None:
    """The search space of a plan, given as plain data; None without ranges, or if a part is wrong.

    The constraints are the texts as they are in the plan.
    """
    parameters = _parameters(plan)
    constraints = as_list(plan.get("constraints"))
    names = [parameter.get("name") for parameter in parameters]
    if (
        not has_ranges(plan)
        or any(place[0] == "parameters" for place in _places(plan))
        or len(set(map(str, names))) < len(names)
        or not all(isinstance(constraint, str) for constraint in constraints)
    ):
        return None
    try:
        return space_between(
            [Parameter.model_validate(parameter) for parameter in parameters],
            [str(constraint) for constraint in constraints],
        )
    except ValidationError:
        return None


def space_between(parameters: Sequence[Parameter], constraints: Sequence[str]) -> SearchSpace:
    """The search space of parameters that all have a range."""
    bounds = [(one.min, one.max) for one in parameters]
    return SearchSpace(
        names=tuple(one.name for one in parameters),
        low=tuple(low for low, _ in bounds if low is not None),
        high=tuple(high for _, high in bounds if high is not None),
        step=tuple(one.step for one in parameters),
        log=tuple(one.scale == LOG for one in parameters),
        constraints=tuple(constraints),
    )


_NUMBERS = ("min", "max", "step")


def _range_inconsistencies(
    place: Place, parameter: Mapping[str, object]
) -> Iterator[Inconsistency]:
    name = parameter.get("name")
    if isinstance(name, str) and name in COMMAND_PLACEHOLDERS:
        taken = f"expected another name, the command of a machine has {{{name}}} already"
        yield Inconsistency((*place, "name"), taken)
    low, high, step = (_number(parameter.get(key)) for key in _NUMBERS)
    for key in ("min", "max"):
        if parameter.get(key) is None:
            message = f"expected min and max of every parameter or of none, got no {key}"
            yield Inconsistency((*place, key), message)
    if low is None or high is None:
        return
    if not low < high:
        message = f"expected a number above min ({low:g}), got {high:g}"
        yield Inconsistency((*place, "max"), message)
    elif high - low < NARROWEST_RANGE * max(abs(low), abs(high)):
        message = f"expected a range of at least {NARROWEST_RANGE:g} of its bounds"
        yield Inconsistency((*place, "max"), f"{message}, got {low!r} to {high!r}")
    elif step is not None and step > high - low:
        message = f"expected a step of at most the range ({high - low:g}), got {step:g}"
        yield Inconsistency((*place, "step"), message)
    if parameter.get("scale") == LOG and low <= 0:
        message = f"expected a number above 0 on a logarithmic scale, got {low:g}"
        yield Inconsistency((*place, "min"), message)


def _what_needs_a_list(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """Methods that choose from a list, and stages that need videos before the first query."""
    for index, condition in enumerate(map(as_mapping, as_list(plan.get("conditions")))):
        method = condition.get("method")
        if isinstance(method, str) and method != RANGE_METHOD:
            message = f"expected {RANGE_METHOD} for parameters with ranges, got {method}"
            yield Inconsistency(("conditions", index, "method"), message)
    for section, key in (("familiarisation", "videos"), ("practice", "queries")):
        number = as_mapping(plan.get(section)).get(key)
        if number:
            yield Inconsistency((section, key), f"expected 0, {_NO_VIDEOS}, got {number}")
    if plan.get("device_check") is not None:
        # It plays one of the study's videos, to see whether the device can.
        message = f"expected no device check, {_NO_VIDEOS}, got one"
        yield Inconsistency(("device_check",), message)
    checks = as_mapping(plan.get("checks"))
    if checks.get("attention"):
        message = f"expected 0, {_NO_VIDEOS}, got {checks['attention']}"
        yield Inconsistency(("checks", "attention"), message)
    for key in ("good", "bad"):
        if points := as_list(checks.get(key)):
            message = f"expected no candidates, {_NO_VIDEOS}, got {len(points)}"
            yield Inconsistency(("checks", key), message)


_NO_VIDEOS = "a study over ranges has no videos before its first query"


def _places(plan: Mapping[str, object]) -> Iterator[Place]:
    return (one.place for one in space_inconsistencies(plan))


def _parameters(plan: Mapping[str, object]) -> list[Mapping[str, object]]:
    return [as_mapping(parameter) for parameter in as_list(plan.get("parameters"))]


def _number(value: object) -> float | None:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    return float(value) if abs(value) <= LARGEST_BOUND else None
