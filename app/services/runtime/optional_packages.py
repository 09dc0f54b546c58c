"""Checks for optional packages; the error names the extra to install."""

from __future__ import annotations

from importlib.util import find_spec

from .errors import ConflictError


def require_queue() -> None:
    """Raise ConflictError if Procrastinate, which only workers need, is not installed."""
    if find_spec("procrastinate") is None:
        raise ConflictError(
            "expected Procrastinate to be installed, which PBPO_WORKERS_APART needs, and it is not:"
            " pip install 'pbpo-studio[postgresql]'"
        )
