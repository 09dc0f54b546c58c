"""Common settings of a study as fields of a form, written back into the same `study.yaml`.

An unchanged field leaves its part of the file as it is, with its comments; keys that the form does
not have are never changed. Input is written as typed: the validation of the file reports faults.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal
from typing import Any, get_args

from ruamel.yaml.comments import CommentedMap

from . import numbers
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
_NUMBERS = ("queries", "trials", "break", "places", "familiarisation")
#: What no field takes.
MOST_TYPED = 10**9
OUTCOMES: tuple[str, ...] = get_args(Outcome)
_ALLOWS_SKIP = {method.name: method.allows_skip for method in METHODS}
#: More conditions than a session can go through.
MOST_CONDITIONS = 50

Fields = Mapping[str, str]


def fields(text: str) -> dict[str, str]:
    """The values of the form's fields for this file. Raises YamlSyntaxError.

    title:<language> and skip:<n>:<language> hold texts; name:<n>, method:<n> and environment:<n>
    the n-th condition; code:<outcome> and url:<outcome> the ways back.
    """
    data = read_yaml(text).data
    languages = [str(language) for language in as_list(data.get("languages"))]
    found = {"languages": ", ".join(languages)}
    for field, key in SINGLE.items():
        found[field] = _said(data.get(key))
    for language in languages:
        found[f"title:{language}"] = _text(data.get("title"), language, languages)
    found["familiarisation"] = _said(as_mapping(data.get("familiarisation")).get("videos"))
    reward = as_mapping(data.get("reward"))
    found["amount"], found["currency"] = _said(reward.get("amount")), _said(reward.get("currency"))
    recruitment = as_mapping(data.get("recruitment"))
    found["platform"] = _said(recruitment.get("platform")) or "none"
    for outcome in OUTCOMES:
        found[f"code:{outcome}"] = _said(as_mapping(recruitment.get("codes")).get(outcome))
        found[f"url:{outcome}"] = _said(as_mapping(recruitment.get("return_urls")).get(outcome))
    for index, condition in enumerate(map(as_mapping, as_list(data.get("conditions")))):
        for name in ("name", "method", "environment"):
            found[f"{name}:{index}"] = _said(condition.get(name))
        label = as_mapping(condition.get("skip")).get("label")
        for language in languages:
            found[f"skip:{index}:{language}"] = _text(label, language, languages)
    return found


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
            texts = _texts(given, "title", languages, old_languages)
            set_key(data, "title", texts) if texts else remove_key(data, "title")
        for field in changed & set(SINGLE):
            _put(data, SINGLE[field], _value(field, given[field]))
        if "familiarisation" in changed:
            videos = _value("familiarisation", given["familiarisation"])
            said = {**as_mapping(plain.get("familiarisation")), "videos": videos}
            set_key(data, "familiarisation", said if videos is not None else {"videos": 0})
        if changed & {"amount", "currency"}:
            before_it = as_mapping(plain.get("reward"))
            said = {
                key: _value(key, given.get(key, "")) if key in changed else before_it.get(key)
                for key in ("amount", "currency")
            }
            _put(data, "reward", {key: value for key, value in said.items() if value is not None})
        if any(field.partition(":")[0] in ("platform", "code", "url") for field in changed):
            _put(data, "recruitment", _recruitment(plain, given))
        of_conditions = ("name", "method", "environment", "skip", "languages")
        if any(field.partition(":")[0] in of_conditions for field in changed):
            set_key(data, "conditions", _conditions(plain, given, languages, old_languages))

    return edited(text, change)


def _put(data: CommentedMap, key: str, value: Any) -> None:
    if value in (None, {}):
        remove_key(data, key)
    else:
        set_key(data, key, value)


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
        label = _texts(given, f"skip:{index}", languages, old_languages)
        if _ALLOWS_SKIP.get(condition["method"], False) and label:
            condition["skip"] = {**as_mapping(condition.get("skip")), "label": label}
        else:
            condition.pop("skip", None)
        made.append(condition)
    return made


def _texts(
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


def _text(value: object, language: str, languages: list[str]) -> str:
    if isinstance(value, str):
        return value if language == languages[0] else ""
    return _said(as_mapping(value).get(language))


def _value(field: str, typed: str) -> object:
    """A number if one was typed into a numeric field; None if it is empty.

    An ambiguous number stays the typed text, which the validation reports.
    """
    typed = typed.strip()
    number = numbers.read(typed) if field in _NUMBERS or field == "amount" else None
    if not isinstance(number, Decimal) or not 0 <= number < MOST_TYPED:
        return typed or None
    if number == int(number):
        return int(number)
    return float(number) if field == "amount" else typed


def _said(value: object) -> str:
    return "" if value is None else str(value)
