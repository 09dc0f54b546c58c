"""Figures: a tidy table in, an Altair chart out; the same chart for a page, a file and a report.

A table is a sequence of rows, each a mapping from column to value. No figure computes a test or
reads a file: what it shows is in its tables.
"""

from __future__ import annotations

from .bands import bands
from .boxes import boxes
from .counts import counts
from .curves import mean_curves
from .files import png, save, svg
from .intervals import intervals
from .maps import CRANE, maps, side
from .paths import paths
from .scatters import scatters
from .slices import slices
from .strips import strips
from .tables import FigureDataError, Row, Table
from .theme import in_the_dark
from .verdicts import verdicts
from .violins import violins

__all__ = [
    "CRANE",
    "FigureDataError",
    "Row",
    "Table",
    "bands",
    "boxes",
    "counts",
    "in_the_dark",
    "intervals",
    "maps",
    "mean_curves",
    "paths",
    "png",
    "save",
    "scatters",
    "side",
    "slices",
    "strips",
    "svg",
    "verdicts",
    "violins",
]
