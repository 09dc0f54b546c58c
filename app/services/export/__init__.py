"""A study's data as tidy tables, streamed."""

from .columns import Column, Request, Table
from .stream import csv_stream, zip_stream
from .tables import TABLES, ZIPPED

__all__ = ["TABLES", "ZIPPED", "Column", "Request", "Table", "csv_stream", "zip_stream"]
