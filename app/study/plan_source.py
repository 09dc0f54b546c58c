"""Parses the text of `study.yaml` into a Plan, or into every fault with its line."""

import datetime
import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from .parsed_plan import Inconsistency, Place, path_text
from .plan import Plan
from .plan_validation import inconsistencies
from .search_space import SearchSpace, space_of
from .validation_errors import Fault
from .yaml_slips import Slip, mend
from .yaml_source import YamlSource, YamlSyntaxError, read_yaml

STUDY_FILE = "study.yaml"
LONGEST_VALUE_SHOWN = 60
#: A file with more is of something else, and each of them costs time.
MOST_FAULTS = 200
NAME_MARK = "[key]"

#: Returns what is wrong with a condition's settings, or None.
SettingsCheck = Callable[[Mapping[str, Any]], str | None]
#: Returns what is wrong with a search space whose ranges are valid: its constraints, its inside.
SpaceCheck = Callable[[SearchSpace], Iterable[Inconsistency]]


@dataclass(frozen=True)
class PlanReading:
    """The result of parsing: a plan if there is no fault, and the data as far as it is readable.

    slips: slips of YAML, without which the text can be read.
    """

    plan: Plan | None
    data: Mapping[str, object]
    faults: tuple[Fault, ...]
    lines: YamlSource | None = None
    slips: tuple[Slip, ...] = ()


def read_plan(
    text: str,
    settings_check: SettingsCheck | None = None,
    space_check: SpaceCheck | None = None,
) -> PlanReading:
    """Parse and validate the text, with the given checks if any."""
    slips: tuple[Slip, ...] = ()
    try:
        source = read_yaml(text)
    except YamlSyntaxError as error:
        mended = mend(text)
        try:
            # Whatever else is wrong is named as well.
            source = read_yaml(mended.text if mended else text)
        except YamlSyntaxError:
            fault = Fault(STUDY_FILE, error.problem.line, error.problem.message)
            return PlanReading(None, {}, (fault,))
        slips = mended.slips if mended else ()
    plan: Plan | None = None
    found = [Fault(STUDY_FILE, slip.line, slip.message) for slip in slips]
    found += [Fault(STUDY_FILE, problem.line, problem.message) for problem in source.problems]
    try:
        plan = Plan.model_validate(source.data)
    except ValidationError as error:
        said = [
            details
            for details in error.errors(include_url=False)
            if details["type"] != "inconsistent"
        ]
        said = [details for details in said if not _follows(details, said)]
        found.extend(
            _fault(source, _place(details), _message(details)) for details in said[:MOST_FAULTS]
        )
        if len(said) > MOST_FAULTS:
            message = f"expected `key: value` lines, got {len(said) - MOST_FAULTS} more faults"
            found.append(Fault(STUDY_FILE, None, message))
        found.extend(
            _fault(source, inconsistency.place, inconsistency.message)
            for inconsistency in inconsistencies(source.data)
        )
    if settings_check is not None:
        found.extend(_settings_faults(source, settings_check))
    space = space_of(source.data) if space_check is not None else None
    if space_check is not None and space is not None:
        found.extend(_fault(source, one.place, one.message) for one in space_check(space))
    # A field of two wrong parts (a text in two languages) is named once.
    faults = tuple(dict.fromkeys(sorted(found, key=lambda fault: fault.line or 0)))
    return PlanReading(None if faults else plan, source.data, faults, source, slips)


def _settings_faults(source: YamlSource, settings_check: SettingsCheck) -> list[Fault]:
    conditions = source.data.get("conditions")
    faults: list[Fault] = []
    for index, condition in enumerate(conditions if isinstance(conditions, list) else []):
        settings = condition.get("settings", {}) if isinstance(condition, dict) else None
        message = settings_check(settings) if isinstance(settings, dict) else None
        if message is not None:
            faults.append(_fault(source, ("conditions", index, "settings"), message))
    return faults


def _fault(source: YamlSource, place: Place, message: str) -> Fault:
    return Fault(STUDY_FILE, source.line(place), f"{path_text(place)}: {message}")


def _place(details: ErrorDetails) -> Place:
    """Where it is; pydantic marks that a mapping's name is meant, not its value, by a last step."""
    place = details["loc"]
    return place[:-1] if place and place[-1] == NAME_MARK else place


def _follows(details: ErrorDetails, all_details: Sequence[ErrorDetails]) -> bool:
    """Whether a list counts as too short only because its entries have faults."""
    place = details["loc"]
    return details["type"] == "too_short" and any(
        other["loc"][: len(place)] == place and len(other["loc"]) > len(place)
        for other in all_details
    )


def _message(details: ErrorDetails) -> str:
    """Our words for what pydantic found, out of the description of the field it found it in."""
    place, value = details["loc"], details["input"]
    model, expectation = _where(place)
    if details["type"] == "missing":
        return f"expected {expectation}, got no such key"
    if details["type"] == "extra_forbidden":
        known = list(_fields(model))
        near = difflib.get_close_matches(str(place[-1]), known, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        return f"unknown key, expected one of {', '.join(known)}{hint}"
    hint = _hint(value)
    if place and place[-1] == NAME_MARK:
        return f"expected {expectation}, got the name {shown(value)}"
    if place and isinstance(place[-1], int):
        return f"expected an entry of {expectation}, got {shown(value)}{hint}"
    return f"expected {expectation}, got {shown(value)}{hint}"


def _hint(value: object) -> str:
    """What YAML made of a word, if a text was meant."""
    if isinstance(value, bool):
        words = "yes, on and true" if value else "no, off and false"
        return f" (YAML reads {words} so: put quotes around the word if you mean it as a text)"
    if isinstance(value, datetime.date):
        return " (put quotes around it if you mean it as a text)"
    return ""


def _where(place: Place) -> tuple[type[BaseModel], str]:
    """The innermost model on the way to a place, and what is expected there."""
    model: type[BaseModel] = Plan
    expectation = "`key: value` lines"
    last_model = model
    for step in place:
        field = _fields(model).get(step) if isinstance(step, str) else None
        if field is None:
            continue
        last_model = model
        expectation = field.description or expectation
        model = _model_in(field.annotation) or model
    at_field = bool(place) and place[-1] in _fields(last_model)
    return (last_model if at_field else model), expectation


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a model, by their names in the file."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _model_in(annotation: object) -> type[BaseModel] | None:
    """The model that a field's type holds: `Skip` of `Skip | None`, `Condition` of a tuple."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in get_args(annotation):
        model = _model_in(part)
        if model is not None:
            return model
    return None


def shown(value: object) -> str:
    """A value as it appears in a message."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, datetime.date):
        return f"the date {value.isoformat()}"
    if isinstance(value, list | tuple):
        return "an empty list" if not value else f"a list of {len(value)}"
    if isinstance(value, Mapping):
        names = ", ".join(islice(map(str, value), 5)) + (", ..." if len(value) > 5 else "")
        return "an empty mapping" if not value else f"a mapping of {names}"
    text = repr(value)
    shortened = text[: LONGEST_VALUE_SHOWN - 3] + "..."
    return text if len(text) <= LONGEST_VALUE_SHOWN else shortened
