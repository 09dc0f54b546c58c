"""The document model of a report: headings, paragraphs, tables and figures in reading order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


def many(number: int, one: str, several: str = "") -> str:
    """The number with its noun: 1 trial, 2 trials."""
    return f"{number} {one if number == 1 else several or f'{one}s'}"


@dataclass(frozen=True)
class Heading:
    """A heading. level: 2 for a part of the report, 3 for a section within one."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text."""

    text: str


@dataclass(frozen=True)
class Table:
    """A table. Every row is as long as the header, and its first cell is the row's header."""

    caption: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


@dataclass(frozen=True)
class Figure:
    """A figure. caption: its caption. says: its text alternative. drawing: SVG."""

    caption: str
    says: str
    drawing: str


Block = Heading | Paragraph | Table | Figure


@dataclass(frozen=True)
class Report:
    """A report in English, under the study's title."""

    title: str
    subtitle: str
    blocks: Sequence[Block]
