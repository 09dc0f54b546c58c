"""Names the common slips of YAML in plain words, and mends them line by line.

A text that YAML cannot read is mended at the line at which it stops, and read again, until it can
be read or no remedy helps. Lines keep their numbers, so that other faults can be named as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import yaml

#: PyYAML is slow: a longer text is not mended, and no text is read more often.
_LONGEST_TEXT: Final = 30_000
_MOST_READINGS: Final = 60
_ENTRY: Final = re.compile(r"(\s*(?:- +)*)([A-Za-z_][\w-]*)(:[ \t]+)(.*?)(\s*)$")
_FLOW_ENTRY: Final = re.compile(
    r"([{,]\s*)([A-Za-z_][\w-]*)(:\s+)(?![\[{])(.*?)(?=\s*(?:,\s*[A-Za-z_][\w-]*:\s|[}\]]*\s*$|\}))"
)
_PLAIN: Final = re.compile(r"-?[0-9.]+|true|false|null|[A-Za-z_][\w-]*|")


@dataclass(frozen=True)
class Slip:
    """What is wrong in a line, counted from 1, and how it is written right."""

    line: int
    message: str


@dataclass(frozen=True)
class Mended:
    """A text that can be read, and the slips that were mended in it."""

    text: str
    slips: tuple[Slip, ...]


def mend(text: str) -> Mended | None:
    """The text without its slips; None if it cannot be read even so, or has none."""
    lines = text.split("\n")
    slips: list[Slip] = []
    readings = 1
    stop = _stop(text) if len(text) <= _LONGEST_TEXT else None
    while stop is not None:
        for place, line, message in _remedies(lines, stop):
            readings += 1
            reached = _stop("\n".join([*lines[:place], line, *lines[place + 1 :]]))
            if reached is None or reached.line > stop.line:
                lines[place], stop = line, reached
                slips.append(Slip(place + 1, message))
                break
            if readings > _MOST_READINGS:
                return None
        else:
            return None
    return Mended("\n".join(lines), tuple(slips)) if slips else None


class _Stop(NamedTuple):
    """The lines, from 0, at which YAML stops, and at which the part began that it cannot read."""

    line: int
    began: int


def _stop(text: str) -> _Stop | None:
    """Where YAML stops; None if it reads all."""
    try:
        yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        began = error.context_mark or mark
        return _Stop(mark.line, began.line) if mark and began else _Stop(0, 0)
    except (yaml.YAMLError, RecursionError):
        return _Stop(0, 0)
    return None


def _remedies(lines: list[str], stop: _Stop) -> Iterator[tuple[int, str, str]]:
    """The ways to change one line near the one at which YAML stops."""
    for place in dict.fromkeys((stop.line, stop.line - 1, stop.line - 2, stop.began)):
        if not 0 <= place < len(lines):
            continue
        for remedy in (_without_tabs, _quoted_in_flow, _quoted, _quoted_again):
            changed = remedy(lines[place])
            if changed is None or changed[0] == lines[place]:
                continue
            yield place, *changed
        for line, message in _indented(lines, place):
            yield place, line, message


def _without_tabs(line: str) -> tuple[str, str] | None:
    blank = line[: len(line) - len(line.lstrip())]
    if "\t" not in blank:
        return None
    return blank.replace("\t", "  ") + line.lstrip(), (
        "expected spaces at the beginning of the line, got a tab"
    )


def _quoted(line: str) -> tuple[str, str] | None:
    """The text after `key:` in quotes."""
    found = _ENTRY.match(line)
    if found is None or found[4][:1] in ("[", "{", "|", ">", "#"):
        return None
    value = _in_quotes(found[4])
    return f"{found[1]}{found[2]}{found[3]}{value}{found[5]}", _say(f"{found[2]}: {value}")


def _quoted_in_flow(line: str) -> tuple[str, str] | None:
    """The texts within `{...}` in quotes, as far as they are more than a word."""
    changed: list[str] = []

    def quote(found: re.Match[str]) -> str:
        if _PLAIN.fullmatch(found[4]) or re.fullmatch(r'"[^"\\]*"', found[4]):
            return found[0]
        value = _in_quotes(found[4])
        changed.append(f"{found[2]}: {value}")
        return f"{found[1]}{found[2]}{found[3]}{value}"

    new = _FLOW_ENTRY.sub(quote, line)
    return (new, _say(", ".join(changed))) if changed else None


def _quoted_again(line: str) -> tuple[str, str] | None:
    """An entry of a list, `- text`, in quotes."""
    found = re.match(r"(\s*- +)(?![\[{\"'|>])(.+?)\s*$", line)
    if found is None:
        return None
    value = _in_quotes(found[2])
    return f"{found[1]}{value}", _say(f"- {value}")


def _indented(lines: list[str], place: int) -> Iterator[tuple[str, str]]:
    """The line with the indentation of a line before it, or one level within it."""
    line = lines[place]
    depth = len(line) - len(line.lstrip(" "))
    for before in reversed(lines[max(0, place - 5) : place]):
        if not before.strip() or before.lstrip().startswith("#"):
            continue
        start = len(before) - len(before.lstrip(" "))
        dash = re.match(r" *- +", before)
        wanted = len(dash[0]) if dash else start
        if wanted != depth:
            yield (
                " " * wanted + line.lstrip(" "),
                (
                    f"expected {wanted} spaces at the beginning of the line, as it belongs to the"
                    f" lines before it, got {depth}"
                ),
            )


def _in_quotes(value: str) -> str:
    """The text in quotes; quotes around it that did not hold are left out."""
    inner = value.strip()
    if len(inner) > 1 and inner[0] == inner[-1] and inner[0] in "'\"":
        inner = inner[1:-1]
    elif inner[:1] in ("'", '"') and inner.count(inner[0]) == 1:
        inner = inner[1:]
    escaped = inner.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _say(written: str) -> str:
    return f"expected quotes around the text: write {written}"
