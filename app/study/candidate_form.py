"""Fields of the settings form about candidates: their source, parameters, and runs of machines.

parameter:<n>, label:<n>:<language>, unit:<n>, min:<n>, max:<n>, step:<n> and scale:<n> are the n-th
parameter, <setting>:<n> the runs asked of machines in the n-th environment. A parameter whose name
is emptied is removed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from ruamel.yaml.comments import CommentedMap

from .environments import CRANE, CRANE_MACHINE, MACHINE, MACHINES, RolloutSettings
from .form_values import Fields, put, said_of, text_of, texts_of, value_of
from .parsed_plan import as_list, as_mapping
from .search_space import MOST_PARAMETERS, has_ranges
from .yaml_edit import set_key

#: Values of the field `candidates`: those of a list, whose videos exist, or all within ranges.
LIST: Final = "list"
RANGES: Final = "ranges"
#: Settings of rollouts, in their order.
ROLLOUT: Final = tuple(RolloutSettings.model_fields)
_BOUNDS: Final = ("min", "max", "step")
#: More parameters than a study over ranges may have: one of a list may have more.
MOST_ROWS: Final = 10 * MOST_PARAMETERS


def fields(data: Mapping[str, Any], languages: list[str]) -> dict[str, str]:
    """The values of the fields for this plan, given as plain data."""
    found = {
        "candidates": _kind(data),
        "constraints": "\n".join(map(said_of, as_list(data.get("constraints")))),
    }
    for index, parameter in enumerate(map(as_mapping, as_list(data.get("parameters")))):
        found[f"parameter:{index}"] = said_of(parameter.get("name"))
        for key in ("unit", *_BOUNDS, "scale"):
            found[f"{key}:{index}"] = said_of(parameter.get(key))
        for language in languages:
            label = text_of(parameter.get("label"), language, languages)
            found[f"label:{index}:{language}"] = label
    for index, environment in enumerate(as_mapping(data.get("environments")).values()):
        rollout = as_mapping(as_mapping(environment).get("rollout"))
        for key in ROLLOUT:
            found[f"{key}:{index}"] = said_of(rollout.get(key))
    return found


def write(
    data: CommentedMap,
    plain: Mapping[str, Any],
    given: Fields,
    changed: Collection[str],
    languages: list[str],
    old_languages: list[str],
) -> None:
    """Write the changed fields into the plan.

    The change to a list removes what a list cannot have: ranges, constraints, settings of rollouts.
    """
    kinds = {field.partition(":")[0] for field in changed}
    to_list = "candidates" in changed and given["candidates"] == LIST
    if to_list or kinds & {"parameter", "label", "unit", "scale", *_BOUNDS, "languages"}:
        parameters = _parameters(plain, given, changed, languages, old_languages)
        if to_list:
            parameters = [
                {key: one for key, one in each.items() if key not in (*_BOUNDS, "scale")}
                for each in parameters
            ]
        put(data, "parameters", parameters)
    if to_list or "constraints" in changed:
        lines = [] if to_list else given["constraints"].splitlines()
        put(data, "constraints", [line.strip() for line in lines if line.strip()])
    if kinds & {"candidates", *ROLLOUT}:
        for index, name in enumerate(as_mapping(plain.get("environments"))):
            environment = _environment(plain, name, index, given, changed)
            if isinstance(environment, dict):
                set_key(data["environments"], name, environment)


def _kind(data: Mapping[str, Any]) -> str:
    sources = [
        as_mapping(environment).get("source")
        for environment in as_mapping(data.get("environments")).values()
    ]
    return RANGES if has_ranges(data) or any(one in MACHINES for one in sources) else LIST


def _parameters(
    plain: Mapping[str, Any],
    given: Fields,
    changed: Collection[str],
    languages: list[str],
    old_languages: list[str],
) -> list[dict[str, Any]]:
    """The parameters as typed; one with an empty name is removed."""
    old = [dict(as_mapping(parameter)) for parameter in as_list(plain.get("parameters"))]
    made = []
    for index in range(MOST_ROWS):
        there: dict[str, Any] = old[index] if index < len(old) else {}
        name = given.get(f"parameter:{index}", said_of(there.get("name"))).strip()
        if not name:
            continue
        there["name"] = name
        is_by_language = "languages" in changed and isinstance(there.get("label"), dict)
        if is_by_language or any(field.startswith(f"label:{index}:") for field in changed):
            there["label"] = texts_of(given, f"label:{index}", languages, old_languages)
        for key in ("unit", *_BOUNDS, "scale"):
            if (field := f"{key}:{index}") in changed:
                there[key] = value_of(given[field]) if key in _BOUNDS else given[field].strip()
        made.append({key: value for key, value in there.items() if value not in (None, "", {})})
    return made


def _environment(
    plain: Mapping[str, Any], name: str, index: int, given: Fields, changed: Collection[str]
) -> object:
    """The environment with the source and the settings of rollouts that the form says."""
    before = as_mapping(plain.get("environments"))[name]
    if not isinstance(before, Mapping):
        return before
    made = dict(before)
    rollout = dict(as_mapping(made.pop("rollout", None)))
    if "candidates" in changed:
        is_list = given["candidates"] == LIST
        made["source"] = _source(made.get("source"), name, list(plain["environments"]), is_list)
        rollout = {} if is_list else rollout
    for key in ROLLOUT:
        if (field := f"{key}:{index}") in changed:
            rollout[key] = _setting(key, given[field])
    rollout = {key: value for key, value in rollout.items() if value is not None}
    return {**made, "rollout": rollout} if rollout else made


def _source(before: object, name: str, environments: Sequence[str], is_list: bool) -> object:
    """The counterpart of a source among lists, or among machines."""
    if is_list and before in MACHINES:
        table = "recordings.csv" if len(environments) == 1 else f"{name}.csv"
        return CRANE if before == CRANE_MACHINE else table
    if not is_list and before not in MACHINES:
        return CRANE_MACHINE if before == CRANE else MACHINE
    return before


def _setting(key: str, typed: str) -> object:
    if key == "reuse":
        typed = typed.strip()
        return {"true": True, "false": False}.get(typed, typed or None)
    return value_of(typed, whole=True, least=0)
