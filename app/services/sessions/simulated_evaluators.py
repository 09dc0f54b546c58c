"""Stores with a simulated session who answered it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.services.context import AppContext

from . import lookup


def record(app: AppContext, token: str, evaluator: Mapping[str, Any]) -> None:
    """Store the evaluator of a simulated session.

    evaluator: `kind`, `seed` and `index`, which seed its random numbers, and its settings.
    """
    with app.database.write() as db:
        lookup.find(app, db, token, to_write=True).evaluator = dict(evaluator)
