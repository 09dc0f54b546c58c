"""Logs as one JSON object per line.

Lines contain no personal data: no client address, no query string, no body. All lines of one
request have the same `request_id`, whichever module writes them.
"""

from __future__ import annotations

import logging
import sys
from typing import TextIO

import structlog

#: Fields of every line, also of those that libraries write.
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
        # Without local variables, which would contain data from requests.
        structlog.processors.format_exc_info,
        structlog.processors.EventRenamer("message"),
        structlog.processors.JSONRenderer(),
    ],
)


def write_json(stream: TextIO = sys.stderr, level: int = logging.INFO) -> logging.Handler:
    """Write all logs of this process to `stream` as JSON from now on. Returns the handler."""
    handler = logging.StreamHandler(stream)
    handler.setFormatter(_FORMATTER)
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level)
    for chatty in ("alembic", "httpx", "httpcore"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    return handler
