"""Reads YAML with the line number of every key and list item.

PyYAML's own loader discards line numbers, and silently keeps the last of two equal keys.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from .parsed_plan import Place, path_text

# PyYAML's composer calls itself for every level: deeper than this is no study, and would exhaust
# the stack.
DEEPEST_LEVEL = 50
#: A longer text is no plan, and PyYAML's own reader, which names slips, would take minutes for it.
LONGEST_TEXT = 100_000
#: A longer number, or date, is a slip; one of 20,000 digits takes seconds to be read.
LONGEST_NUMBER = 60
#: The range of integers that databases store.
LARGEST_WHOLE = 2**63 - 1
#: libyaml's where PyYAML was built with it.
FASTEST_LOADER: type[Any] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_IN_DIGITS = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_UNSTORABLE = re.compile("[\0\ud800-\udfff]")
_NUMBERS = frozenset(f"tag:yaml.org,2002:{name}" for name in ("int", "float", "timestamp"))


@dataclass(frozen=True)
class YamlProblem:
    """A fault in a YAML text and its line, counted from 1."""

    line: int
    message: str


class YamlSyntaxError(Exception):
    """The text is not a YAML mapping, so nothing in it can be checked."""

    def __init__(self, problem: YamlProblem) -> None:
        super().__init__(f"line {problem.line}: {problem.message}")
        self.problem = problem


@dataclass(frozen=True)
class YamlSource:
    """The data of a YAML file, the line of every place in it, and its repeated keys."""

    data: Mapping[str, object]
    lines: Mapping[Place, int]
    problems: tuple[YamlProblem, ...]

    def line(self, place: Place) -> int:
        """The line of the place, or of the nearest enclosing part of the file."""
        while place and place not in self.lines:
            place = place[:-1]
        return self.lines.get(place, 1)


@dataclass
class _Reader:
    """Converts a node tree into data, recording lines and repeated keys."""

    lines: dict[Place, int] = field(default_factory=dict)
    problems: list[YamlProblem] = field(default_factory=list)
    constructor: yaml.constructor.SafeConstructor = field(
        default_factory=yaml.constructor.SafeConstructor
    )

    def value(self, node: yaml.Node, place: Place) -> object:
        self.lines.setdefault(place, _line(node))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, place)
        if isinstance(node, yaml.SequenceNode):
            return [self.value(item, (*place, index)) for index, item in enumerate(node.value)]
        return self._scalar(node)

    def _scalar(self, node: yaml.Node) -> object:
        came = _short(str(node.value))
        if node.tag in _NUMBERS and len(node.value) > LONGEST_NUMBER:
            raise YamlSyntaxError(
                YamlProblem(
                    _line(node),
                    f"expected a number of at most {LONGEST_NUMBER} characters, or a text in"
                    f" quotes, got {came}",
                )
            )
        try:
            scalar: object = self.constructor.construct_object(node)
        except (
            yaml.YAMLError,
            ArithmeticError,
            AttributeError,
            LookupError,
            TypeError,
            ValueError,
        ) as error:
            # A date such as 2024-13-01 has the form of one and is none; `!!bool maybe` says that it
            # is what it is not. PyYAML lets whatever its conversion raises through.
            raise YamlSyntaxError(
                YamlProblem(_line(node), f"expected a value, got {came}")
            ) from error
        if isinstance(scalar, int) and abs(scalar) > LARGEST_WHOLE:
            raise YamlSyntaxError(
                YamlProblem(
                    _line(node), f"expected a whole number of at most 18 digits, got {came}"
                )
            )
        if isinstance(scalar, str):
            _require_storable(node, scalar)
        if isinstance(scalar, int | float) and not _is_as_it_looks(node, scalar):
            message = f"expected a number in digits such as 1000 or 0.5, got {came}"
            message += f", which YAML reads as {scalar}: write that, or a text in quotes"
            self.problems.append(YamlProblem(_line(node), message))
        return scalar

    def _mapping(self, node: yaml.MappingNode, place: Place) -> dict[str, object]:
        data: dict[str, object] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                message = "expected a plain word as a key, got a list or a mapping"
                self.problems.append(YamlProblem(_line(key_node), message))
                continue
            # As written: YAML would read the keys `no` and `on` as booleans.
            key = key_node.value
            _require_storable(key_node, key)
            inner = (*place, key)
            if key in data:
                message = f"{path_text(inner)}: expected each key once, got it again"
                message += f" (first in line {self.lines[inner]})"
                self.problems.append(YamlProblem(_line(key_node), message))
                continue
            self.lines[inner] = _line(key_node)
            data[key] = self.value(value_node, inner)
        return data


def _is_as_it_looks(node: yaml.Node, scalar: float) -> bool:
    """Not so 1_000, 010 (which YAML 1.1 takes for 8) and 1:30 (for 90)."""
    if isinstance(scalar, bool) or not math.isfinite(scalar):
        return True
    return _IN_DIGITS.fullmatch(str(node.value)) is not None


def read_yaml(text: str) -> YamlSource:
    """The mapping that a YAML text holds; raises YamlSyntaxError if it holds none."""
    if len(text) > LONGEST_TEXT:
        raise YamlSyntaxError(
            YamlProblem(1, f"expected at most {LONGEST_TEXT:,} characters, got {len(text):,}")
        )
    try:
        node = _composed(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        said = ", ".join(part for part in (error.context, error.problem) if part)
        line = mark.line + 1 if mark else 1
        raise YamlSyntaxError(YamlProblem(line, f"expected YAML, got a slip: {said}")) from error
    except yaml.reader.ReaderError as error:
        line = text[: error.position].count("\n") + 1
        message = f"expected YAML, got the character {error.character!r}"
        raise YamlSyntaxError(YamlProblem(line, message)) from error
    if not isinstance(node, yaml.MappingNode):
        came = "nothing" if node is None else "something else"
        message = f"expected `key: value` lines, got {came}"
        raise YamlSyntaxError(YamlProblem(1, message))
    reader = _Reader()
    data = reader.value(node, ())
    assert isinstance(data, dict)  # a mapping node makes one
    return YamlSource(data, reader.lines, tuple(reader.problems))


def _composed(text: str) -> yaml.Node | None:
    """The node tree by libyaml, twenty times as fast; a slip is named by PyYAML's own reader."""
    try:
        return _composed_by(FASTEST_LOADER, text)
    except yaml.YAMLError:
        return _composed_by(yaml.SafeLoader, text)


def _composed_by(loader: type[Any], text: str) -> yaml.Node | None:
    _refuse_aliases_and_depth(loader, text)
    node: yaml.Node | None = yaml.compose(text, Loader=loader)
    return node


def _refuse_aliases_and_depth(loader: type[Any], text: str) -> None:
    """Refuse aliases, which can repeat or contain themselves without end, and excessive depth."""
    depth = 0
    for event in yaml.parse(text, Loader=loader):
        line = _line(event)
        if isinstance(event, yaml.AliasEvent):
            message = f"expected the value itself, got the alias *{event.anchor}"
            raise YamlSyntaxError(YamlProblem(line, message))
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEEPEST_LEVEL:
            message = f"expected at most {DEEPEST_LEVEL} levels, got more"
            raise YamlSyntaxError(YamlProblem(line, message))


def _require_storable(node: yaml.Node, text: str) -> None:
    """Refuse NUL and half a pair of surrogates, which YAML can escape and databases cannot hold."""
    odd = _UNSTORABLE.search(text)
    if odd is not None:
        message = f"expected letters that can be stored, got the character {odd[0]!a}"
        raise YamlSyntaxError(YamlProblem(_line(node), message))


def _short(text: str) -> str:
    return repr(text if len(text) <= LONGEST_NUMBER else f"{text[:LONGEST_NUMBER]}...")


def _line(node: yaml.Node | yaml.Event) -> int:
    # Only nodes and events made by hand have no mark.
    assert node.start_mark is not None
    line: int = node.start_mark.line
    return line + 1
