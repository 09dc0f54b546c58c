"""Common settings of a study as fields of a form, written back into the same `study.yaml`.

An unchanged field leaves its part of the file as it is, with its comments; keys that the form does
not have are never changed. Input is written as typed: the validation of the file reports faults.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, get_args

from ruamel.yaml.comments import CommentedMap

from . import candidate_form
from .form_values import Fields, put, said_of, text_of, texts_of, value_of
from .parsed_plan import as_list, as_mapping
from .plan_validation import METHODS
from .recruitment import Outcome
from .yaml_edit import edited, remove_key, set_key
from .yaml_source import read_yaml

#: Field -> key of the plan, for those that hold one value.
SINGLE = {
    "slug": "slug",
    "queries": "queries_per_trial",
    "trials": "trials_per_condition",
    "break": "break_s",
    "places": "places",
    "contact": "contact",
}
#: Field -> part of the plan and key in it, for numbers that stand in a part of their own.
_IN_PARTS = {"familiarisation": ("familiarisation", "videos"), "practice": ("practice", "queries")}
_STOP = {"stop_sure": "sure", "stop_within": "within"}
_WHOLE_NUMBERS = ("queries", "trials", "break", "places", *_IN_PARTS)
OUTCOMES: tuple[str, ...] = get_args(Outcome)
_ALLOWS_SKIP = {method.name: method.allows_skip for method in METHODS}
#: More conditions than a session can go through.
MOST_CONDITIONS = 50


def fields(text: str) -> dict[str, str]:
    """The values of the form's fields for this file. Raises YamlSyntaxError.

    title:<language> and skip:<n>:<language> hold texts; name:<n>, method:<n> and environment:<n>
    the n-th condition; code:<outcome> and url:<outcome> the ways back. Those of candidates are in
    `candidate_form`.
    """
    data = read_yaml(text).data
    languages = [str(language) for language in as_list(data.get("languages"))]
    found = {"languages": ", ".join(languages)}
    for field, key in SINGLE.items():
        found[field] = said_of(data.get(key))
    for language in languages:
        found[f"title:{language}"] = text_of(data.get("title"), language, languages)
    for field, (part, key) in _IN_PARTS.items():
        found[field] = said_of(as_mapping(data.get(part)).get(key))
    for field, key in _STOP.items():
        found[field] = said_of(as_mapping(data.get("stop")).get(key))
    reward = as_mapping(data.get("reward"))
    found["amount"], found["currency"] = (
        said_of(reward.get("amount")),
        said_of(reward.get("currency")),
    )
    recruitment = as_mapping(data.get("recruitment"))
    found["platform"] = said_of(recruitment.get("platform")) or "none"
    for outcome in OUTCOMES:
        found[f"code:{outcome}"] = said_of(as_mapping(recruitment.get("codes")).get(outcome))
        found[f"url:{outcome}"] = said_of(as_mapping(recruitment.get("return_urls")).get(outcome))
    for index, condition in enumerate(map(as_mapping, as_list(data.get("conditions")))):
        for name in ("name", "method", "environment"):
            found[f"{name}:{index}"] = said_of(condition.get(name))
        label = as_mapping(condition.get("skip")).get("label")
        for language in languages:
            found[f"skip:{index}:{language}"] = text_of(label, language, languages)
    return found | candidate_form.fields(data, languages)


def environments(text: str) -> list[str]:
    """The environments that a condition can have."""
    return list(as_mapping(read_yaml(text).data.get("environments")))


def written(text: str, given: Fields) -> str:
    """The file with the values of the form. Raises UneditableError, YamlSyntaxError."""
    before = fields(text)
    changed = {field for field, value in given.items() if value.strip() != before.get(field, "")}
    if not changed:
        return text
    plain = read_yaml(text).data
    old_languages = [str(language) for language in as_list(plain.get("languages"))]
    languages = [one for one in re.split(r"[\s,]+", given.get("languages", "")) if one]

    def change(data: CommentedMap) -> None:
        if "languages" in changed:
            set_key(data, "languages", languages)
        if "languages" in changed or any(field.startswith("title:") for field in changed):
            texts = texts_of(given, "title", languages, old_languages)
            set_key(data, "title", texts) if texts else remove_key(data, "title")
        for field in changed & set(SINGLE):
            put(data, SINGLE[field], _value(field, given[field]))
        for field, (part, key) in _IN_PARTS.items():
            if field in changed:
                number = _value(field, given[field])
                said = {**as_mapping(plain.get(part)), key: number}
                set_key(data, part, said if number is not None else {key: 0})
        if changed & set(_STOP):
            stop = dict(as_mapping(plain.get("stop")))
            for field in changed & set(_STOP):
                stop[_STOP[field]] = value_of(given[field])
            put(data, "stop", {key: one for key, one in stop.items() if one is not None})
        candidate_form.write(data, plain, given, changed, languages, old_languages)
        if changed & {"amount", "currency"}:
            before_it = as_mapping(plain.get("reward"))
            said = {
                key: _value(key, given.get(key, "")) if key in changed else before_it.get(key)
                for key in ("amount", "currency")
            }
            put(data, "reward", {key: value for key, value in said.items() if value is not None})
        if any(field.partition(":")[0] in ("platform", "code", "url") for field in changed):
            put(data, "recruitment", _recruitment(plain, given))
        of_conditions = ("name", "method", "environment", "skip", "languages")
        if any(field.partition(":")[0] in of_conditions for field in changed):
            set_key(data, "conditions", _conditions(plain, given, languages, old_languages))

    return edited(text, change)


def _recruitment(plain: Mapping[str, object], given: Fields) -> dict[str, Any]:
    said = dict(as_mapping(plain.get("recruitment")))
    said["platform"] = given.get("platform", "none")
    for key, field in (("codes", "code"), ("return_urls", "url")):
        ways = dict(as_mapping(said.get(key)))
        for outcome in OUTCOMES:
            typed = given.get(f"{field}:{outcome}")
            if typed is not None:
                ways[outcome] = typed.strip()
        said[key] = {outcome: way for outcome, way in ways.items() if way}
        if not said[key]:
            del said[key]
    return {} if said == {"platform": "none"} else said


def _conditions(
    plain: Mapping[str, object],
    given: Fields,
    languages: list[str],
    old_languages: list[str],
) -> list[dict[str, Any]]:
    """The conditions as typed; one with an empty name is removed."""
    old = [dict(as_mapping(condition)) for condition in as_list(plain.get("conditions"))]
    made = []
    for index in range(MOST_CONDITIONS):
        name = given.get(f"name:{index}", "").strip()
        if not name:
            continue
        condition: dict[str, Any] = old[index] if index < len(old) else {}
        condition["name"] = name
        for key in ("method", "environment"):
            condition[key] = given.get(f"{key}:{index}", "").strip()
        label = texts_of(given, f"skip:{index}", languages, old_languages)
        if _ALLOWS_SKIP.get(condition["method"], False) and label:
            condition["skip"] = {**as_mapping(condition.get("skip")), "label": label}
        else:
            condition.pop("skip", None)
        made.append(condition)
    return made


def _value(field: str, typed: str) -> object:
    """The input of a field: a number where numbers belong, else the text; None if it is empty."""
    if field not in _WHOLE_NUMBERS and field != "amount":
        return typed.strip() or None
    return value_of(typed, whole=field in _WHOLE_NUMBERS, least=0)
