"""Validation across the fields of a plan.

These checks read the plan as plain data and skip values that are missing or of a wrong type (the
fields' own rules report those), so that one pass over a broken file finds every fault.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from . import recruitment, retention
from .analysis import analysis_inconsistencies
from .attention_checks import checks_inconsistencies
from .environments import environment_inconsistencies
from .parsed_plan import (
    Inconsistency,
    Place,
    all_languages,
    as_list,
    as_mapping,
    languages_of,
    repeats,
)
from .query_settings import query_inconsistencies, skip_inconsistencies
from .questionnaire import item_inconsistencies
from .search_space import space_inconsistencies
from .stage_settings import PRACTICE
from .stopping import stop_inconsistencies

# Columns that exported tables and recordings.csv have of their own: a parameter of the same name
# would give a table two columns with one name ("candidate" would become a second left_candidate).
RESERVED_PARAMETERS = frozenset(
    {
        "candidate",
        "duration_s",
        "environment",
        "file",
        "posterior_mean",
        "posterior_std",
        "query_index",
        "public_id",
        "recording",
        "run",
        "score",
        "session_id",
        "sha256",
        "source",
        "study",
        "sureness",
        "trial_index",
    }
)


@dataclass(frozen=True)
class Method:
    """A method of choosing queries, and whether evaluators may skip under it (Section IV-B)."""

    name: str
    allows_skip: bool


METHODS = (
    Method("pbpo", allows_skip=True),
    Method("pbpo-no-synthesis", allows_skip=True),
    Method("pbpo-no-skip", allows_skip=False),
    Method("knockout", allows_skip=False),
    Method("pbpo-threshold", allows_skip=True),
)


def inconsistencies(plan: Mapping[str, object]) -> list[Inconsistency]:
    """All contradictions within a plan, given as plain data."""
    return [
        *_languages(plan),
        *_parameters(plan),
        *space_inconsistencies(plan),
        *environment_inconsistencies(plan),
        *_conditions(plan),
        *_practice(plan),
        *_resume(plan),
        *_familiarisation(plan),
        *stop_inconsistencies(plan),
        *checks_inconsistencies(plan, parameter_names(plan)),
        *recruitment.disagreements(plan),
        *retention.disagreements(plan),
        *_blocks(plan),
        *query_inconsistencies(plan),
        *analysis_inconsistencies(plan),
        *item_inconsistencies(plan, languages_of(plan)),
    ]


def _languages(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    languages = languages_of(plan)
    yield from repeats("languages", as_list(plan.get("languages")))
    yield from all_languages(("title",), plan.get("title"), languages)


def _parameters(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    names = parameter_names(plan)
    yield from repeats("parameters", names, "name")
    for index, name in enumerate(names):
        if name in RESERVED_PARAMETERS:
            taken = f"expected another name, {name!r} is a column that exported tables have already"
            yield Inconsistency(("parameters", index, "name"), taken)


def _conditions(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    conditions = [as_mapping(condition) for condition in as_list(plan.get("conditions"))]
    environments = as_mapping(plan.get("environments"))
    allows_skip = {method.name: method.allows_skip for method in METHODS}
    yield from repeats("conditions", [condition.get("name") for condition in conditions], "name")
    for index, condition in enumerate(conditions):
        place: Place = ("conditions", index)
        environment = condition.get("environment")
        if isinstance(environment, str) and environments and environment not in environments:
            known = ", ".join(environments)
            message = f"expected one of the environments ({known}), got {environment!r}"
            yield Inconsistency((*place, "environment"), message)

        method, skip = condition.get("method"), condition.get("skip")
        if isinstance(method, str) and method in allows_skip:
            if allows_skip[method] and skip is None:
                message = f"expected a skip button's label for method {method}, got none"
                yield Inconsistency((*place, "skip"), message)
            if not allows_skip[method] and skip is not None:
                message = f"expected no skip button for method {method}, got one"
                yield Inconsistency((*place, "skip"), message)
        yield from skip_inconsistencies((*place, "skip"), skip, method, plan)
        yield from _model(place, condition, plan)
        yield from _finite((*place, "settings"), condition.get("settings"))


def _model(
    place: Place, condition: Mapping[str, object], plan: Mapping[str, object]
) -> Iterator[Inconsistency]:
    """A model that people share needs a method that tells them apart, and listed candidates."""
    if condition.get("model") != "shared":
        if condition.get("for") is not None:
            message = "expected model: shared with it, since an own model is for its person"
            yield Inconsistency((*place, "for"), f"{message}, got none")
        return
    method = condition.get("method")
    if method != "pbpo-threshold":
        message = f"expected method pbpo-threshold for a shared model, got {method!r}"
        yield Inconsistency((*place, "model"), message)
    parameters = [as_mapping(parameter) for parameter in as_list(plan.get("parameters"))]
    if any(parameter.get("min") is not None for parameter in parameters):
        message = "expected a model of each person's own where parameters have ranges, got shared"
        yield Inconsistency((*place, "model"), message)


def _familiarisation(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    familiarisation = as_mapping(plan.get("familiarisation"))
    videos, required = familiarisation.get("videos", 0), familiarisation.get("required", 0)
    if isinstance(videos, int) and isinstance(required, int) and required > videos:
        message = f"expected at most the number of videos ({videos}), got {required}"
        yield Inconsistency(("familiarisation", "required"), message)


def _practice(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """In exported tables the practice stands where a condition's name does."""
    for index, condition in enumerate(as_list(plan.get("conditions"))):
        if as_mapping(condition).get("name") == PRACTICE and plan.get("practice") is not None:
            message = f"expected another name, {PRACTICE!r} is what the practice is called"
            yield Inconsistency(("conditions", index, "name"), message)


def _resume(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """Without a maximum age a new visit could not be distinguished from a reload."""
    resume = as_mapping(plan.get("resume"))
    policy = resume.get("policy")
    if policy in ("restart", "block") and resume.get("max_age_hours") is None:
        message = f"expected a number of hours after which policy {policy} holds, got none"
        yield Inconsistency(("resume", "max_age_hours"), message)


def _blocks(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """Blocks of one length: so the place of a trial alone says which block it is in."""
    if plan.get("blocks") != "environment":
        return
    conditions = [as_mapping(condition) for condition in as_list(plan.get("conditions"))]
    sizes = Counter(str(condition.get("environment")) for condition in conditions)
    if len(set(sizes.values())) > 1:
        counted = ", ".join(f"{number} in {name}" for name, number in sizes.items())
        message = f"expected as many conditions in each environment, got {counted}"
        yield Inconsistency(("blocks",), message)


def _finite(place: Place, value: object) -> Iterator[Inconsistency]:
    """Settings go into JSON, which has no infinity and no NaN."""
    if isinstance(value, float) and not math.isfinite(value):
        yield Inconsistency(place, f"expected a finite number, got {value}")
    for key, inner in as_mapping(value).items():
        yield from _finite((*place, key), inner)
    for index, inner in enumerate(as_list(value)):
        yield from _finite((*place, index), inner)


def parameter_names(plan: Mapping[str, object]) -> list[object]:
    """The names of the plan's parameters, as they are in the file."""
    return [as_mapping(parameter).get("name") for parameter in as_list(plan.get("parameters"))]
