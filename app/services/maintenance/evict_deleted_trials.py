"""Evicts trials from this process's caches that another process has deleted.

A deletion evicts the trial in its own process only: a server, a worker or a command. Each server
therefore checks periodically which cached trials still exist. A step that is being computed during
the check is evicted by the next one.
"""

from __future__ import annotations

from sqlalchemy import select

from app.services.context import AppContext
from app.storage.models.studies import Trial


def evict_deleted(app: AppContext) -> int:
    """Evict all cached trials that are not in the database, and return their number."""
    remembered = app.proposer.cached_seeds()
    if not remembered:
        return 0
    with app.database.read() as db:
        kept = db.scalars(select(Trial.seed).where(Trial.seed.in_(remembered)))
        gone = remembered.difference(kept)
    # A trial that is just starting may be evicted too; its steps are computed again.
    app.proposer.evict(gone)
    return len(gone)
