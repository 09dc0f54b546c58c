"""Logs as one JSON object per line, for machines to collect.

A line says what happened, never to whom: no address of a browser, no query string, no body. Lines
of one request share its `request_id`, in whatever module they are written.
"""

from __future__ import annotations

import logging
import sys
from typing import TextIO

import structlog

#: What every line carries, whoever has written it.
_SHARED: list[structlog.types.Processor] = [
    structlog.contextvars.merge_contextvars,
    structlog.stdlib.add_log_level,
    structlog.stdlib.add_logger_name,
    structlog.processors.TimeStamper(fmt="iso", utc=True),
]

_FORMATTER = structlog.stdlib.ProcessorFormatter(
    foreign_pre_chain=[*_SHARED, structlog.stdlib.ExtraAdder()],
    processors=[
        structlog.stdlib.ProcessorFormatter.remove_processors_meta,
        # As text: a traceback with its variables would hold what people sent.
        structlog.processors.format_exc_info,
        structlog.processors.EventRenamer("message"),
        structlog.processors.JSONRenderer(),
    ],
)


def write_json(stream: TextIO = sys.stderr, level: int = logging.INFO) -> logging.Handler:
    """From now on, write every log of this process to `stream` as JSON; the handler that does."""
    handler = logging.StreamHandler(stream)
    handler.setFormatter(_FORMATTER)
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level)
    for chatty in ("alembic", "httpx", "httpcore"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    return handler
