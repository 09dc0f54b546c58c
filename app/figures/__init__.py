"""Figures: a tidy table in, an Altair chart out; the same chart for a page, a file and a report.

A table is a sequence of rows, each a mapping from column to value. No figure computes a test or
reads a file: what it shows is in its tables.
"""

from __future__ import annotations

from app.figures.bands import bands
from app.figures.boxes import boxes
from app.figures.counts import counts
from app.figures.curves import mean_curves
from app.figures.files import png, save, svg
from app.figures.intervals import intervals
from app.figures.looks import in_the_dark
from app.figures.maps import CRANE, maps, side
from app.figures.paths import paths
from app.figures.slices import slices
from app.figures.strips import strips
from app.figures.tables import FigureDataError, Row, Table
from app.figures.violins import violins

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
    "side",
    "slices",
    "strips",
    "svg",
    "violins",
]
