"""Optional packages: raises an error that names the extra to install where one is missing."""

from __future__ import annotations

from importlib.util import find_spec

from .errors import ConflictError


def require_queue() -> None:
    """Raises ConflictError where what workers need is not installed: others do without."""
    if find_spec("procrastinate") is None:
        raise ConflictError(
            "expected Procrastinate to be installed, which PBPO_WORKERS_APART needs, and it is not:"
            " pip install 'pbpo-studio[postgresql]'"
        )
