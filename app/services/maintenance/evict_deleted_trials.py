"""Forgetting what was deleted elsewhere: by another server, by a worker, or by a command.

Whoever deletes a trial forgets it at once, but only in a process of their own. So each server asks
the database now and then which of the trials that it remembers are still kept, and throws away what
it has worked out for all others. What was under way meanwhile is thrown away the next time.
"""

from __future__ import annotations

from sqlalchemy import select

from app.services.context import AppContext
from app.storage.models.studies import Trial


def evict_deleted(app: AppContext) -> int:
    """Throw away what is remembered of trials that are not kept; how many these were."""
    remembered = app.proposer.cached_seeds()
    if not remembered:
        return 0
    with app.database.read() as db:
        kept = db.scalars(select(Trial.seed).where(Trial.seed.in_(remembered)))
        gone = remembered.difference(kept)
    # A trial that is just beginning may be among them: it loses some milliseconds, and no more.
    app.proposer.evict(gone)
    return len(gone)
