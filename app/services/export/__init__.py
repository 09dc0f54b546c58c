"""Exports of a study's data as tidy tables and in other formats, streamed and audited."""

from .filters import ALL_FLAGS, in_words, modes_of, resolve_flags
from .formats import FORMATS, find
from .provenance import ACTIONS, PERSON, recorded, write_folder
from .stream import File, csv_stream, table_file, zip_stream
from .table import Column, Request, Table
from .tables import TABLES, ZIPPED

__all__ = [
    "ACTIONS",
    "ALL_FLAGS",
    "FORMATS",
    "PERSON",
    "TABLES",
    "ZIPPED",
    "Column",
    "File",
    "Request",
    "Table",
    "csv_stream",
    "find",
    "in_words",
    "modes_of",
    "recorded",
    "resolve_flags",
    "table_file",
    "write_folder",
    "zip_stream",
]
