"""Figures: a tidy table in, an Altair chart out; the same chart for a page, a file and a report.

A table is a sequence of rows, each a mapping from column to value. No figure computes a test or
reads a file: what it shows is in its tables.
"""

from __future__ import annotations

from app.figures.boxes import boxes
from app.figures.counts import counts
from app.figures.curves import mean_curves
from app.figures.files import save
from app.figures.maps import maps
from app.figures.tables import FigureDataError, Row, Table
from app.figures.violins import violins

__all__ = [
    "FigureDataError",
    "Row",
    "Table",
    "boxes",
    "counts",
    "maps",
    "mean_curves",
    "save",
    "violins",
]
