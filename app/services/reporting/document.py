"""What a report is made of: headings, paragraphs, tables and figures, in the order of reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


def many(number: int, one: str, several: str = "") -> str:
    """The number with its noun: 1 trial, 2 trials."""
    return f"{number} {one if number == 1 else several or f'{one}s'}"


@dataclass(frozen=True)
class Heading:
    """level: 2 for a part of the report, 3 within one."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    text: str


@dataclass(frozen=True)
class Table:
    """Every row is as long as the header; its first cell names it."""

    caption: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


@dataclass(frozen=True)
class Figure:
    """caption: what is to be seen. says: what it shows, in words. drawing: SVG."""

    caption: str
    says: str
    drawing: str


Block = Heading | Paragraph | Table | Figure


@dataclass(frozen=True)
class Report:
    """A report, in English; its title is the study's."""

    title: str
    subtitle: str
    blocks: Sequence[Block]
