"""Edits parts of a `study.yaml` and keeps comments and all other keys."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from .yaml_source import YamlSyntaxError, read_yaml

#: Wider than any line that a person writes: a line is never broken for its length.
_WIDTH = 100_000


class UneditableError(Exception):
    """The text has a construct that must be corrected by hand first."""


def edited(text: str, change: Callable[[CommentedMap], None]) -> str:
    """The text after `change` was applied to its data. Raises UneditableError."""
    try:
        # Aliases, depth and the rest are refused as they are where a study is read.
        source = read_yaml(text)
    except YamlSyntaxError as error:
        raise UneditableError(str(error)) from error
    if source.problems:
        first = source.problems[0]
        raise UneditableError(f"line {first.line}: {first.message}")
    yaml = _yaml()
    written = io.StringIO()
    try:
        data = yaml.load(text)
        change(data)
        yaml.dump(data, written)
    except (
        YAMLError,
        ArithmeticError,
        AssertionError,
        AttributeError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        # What PyYAML reads, ruamel.yaml may not: merge keys, tags, odd dates, comments in odd
        # places. It raises whatever its own code runs into.
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise UneditableError(f"expected plain YAML, got: {said[:200]}") from error
    return written.getvalue()


def plain(value: Any) -> Any:
    """A value as it is written: texts are quoted.

    Without quotes YAML would read `no` and `1.0` as other types than text.
    """
    if isinstance(value, str):
        return DoubleQuotedScalarString(value)
    if isinstance(value, dict):
        made = CommentedMap({key: plain(inner) for key, inner in value.items()})
        made.fa.set_flow_style()
        return made
    if isinstance(value, list | tuple):
        items = CommentedSeq([plain(inner) for inner in value])
        items.fa.set_flow_style()
        return items
    return value


def set_key(mapping: CommentedMap, key: str, value: Any) -> None:
    """Set a key; equal parts of its old value keep their formatting and comments."""
    old = mapping.get(key)
    tail = _take_tail(old)
    if isinstance(old, CommentedMap) and isinstance(value, dict) and value:
        _put_keys(old, value)
        _give_tail(old, tail)
    elif isinstance(old, CommentedSeq) and isinstance(value, list) and value:
        _put_items(old, value)
        _give_tail(old, tail)
    else:
        if key not in mapping or old != value:
            mapping[key] = plain(value)
        _give_at(mapping, key, tail)


def remove_key(mapping: CommentedMap, key: str) -> None:
    """Remove a key; the comment before the next key stays."""
    if key not in mapping:
        return
    keys = list(mapping)
    place = keys.index(key)
    tail = _take_tail(mapping[key]) or _take_at(mapping, key, 2)
    del mapping[key]
    if place > 0:
        _give_at(mapping, keys[place - 1], tail)


def _put_keys(old: CommentedMap, value: dict[str, Any]) -> None:
    for name in [name for name in old if name not in value]:
        del old[name]
    for name, inner in value.items():
        set_key(old, name, inner)


def _put_items(old: CommentedSeq, value: list[Any]) -> None:
    del old[len(value) :]
    for index, inner in enumerate(value):
        if index >= len(old):
            old.append(plain(inner))
        elif isinstance(old[index], CommentedMap) and isinstance(inner, dict):
            _put_keys(old[index], inner)
        elif old[index] != inner:
            old[index] = plain(inner)


# The parser hangs a comment on the last value before it, however deep that value lies. Where that
# value goes, its comment has to be handed on. In `ca.items` a mapping keeps the comment after a
# value at place 2, a sequence at place 0.


def _take_tail(node: Any) -> Any:
    """Remove and return the comment after the last value within the node."""
    if not isinstance(node, CommentedMap | CommentedSeq) or not node:
        return None
    last, place = _last(node)
    return _take_tail(node[last]) or _take_at(node, last, place)


def _give_tail(node: Any, tail: Any) -> None:
    if tail is None or not node:
        return
    last, place = _last(node)
    inner = node[last]
    is_block = isinstance(inner, CommentedMap | CommentedSeq) and not inner.fa.flow_style()
    if is_block and inner:
        _give_tail(inner, tail)
    else:
        _give_at(node, last, tail, place)


def _last(node: CommentedMap | CommentedSeq) -> tuple[Any, int]:
    return (list(node)[-1], 2) if isinstance(node, CommentedMap) else (len(node) - 1, 0)


def _take_at(node: Any, key: Any, place: int) -> Any:
    around = node.ca.items.get(key)
    if not around or len(around) <= place:
        return None
    found, around[place] = around[place], None
    return found


def _give_at(node: Any, key: Any, tail: Any, place: int = 2) -> None:
    if tail is None:
        return
    inner = node[key]
    if isinstance(inner, CommentedMap | CommentedSeq) and not inner.fa.flow_style():
        _give_tail(inner, tail)
        return
    around = node.ca.items.setdefault(key, [None, None, None, None])
    if around[place] is None:
        around[place] = tail
    else:
        around[place].value += tail.value


def _yaml() -> YAML:
    yaml = YAML(typ="rt")
    yaml.preserve_quotes = True
    yaml.width = _WIDTH
    yaml.indent(mapping=2, sequence=4, offset=2)
    yaml.allow_unicode = True
    return yaml
