"""The return link of a participant whose session failed because of a server error."""

from __future__ import annotations

import logging
from threading import Lock
from typing import Any

from cachetools import LRUCache

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.session_modes import LIVE
from app.study import recruitment
from app.study.plan import Plan
from app.study.recruitment import Outcome
from app.study.stages import Stage

from . import completion, lookup

log = logging.getLogger(__name__)

#: The last plan read per study, for the return link while the database is unreachable.
_last_plans: LRUCache[str, Plan] = LRUCache(repository.MAX_PLANS)
_lock = Lock()


def remember(slug: str, plan: Plan) -> None:
    """Cache a study's plan for use while the database is unreachable."""
    with _lock:
        _last_plans[slug] = plan


def after_a_failure(app: AppContext, slug: str, token: str | None) -> dict[str, Any] | None:
    """The code or return link for a participant after a server error, or None.

    A participant with a response to every query has completed the study as far as they could, and
    gets the code of completion; the others get that of a technical failure.
    """
    try:
        with app.database.read() as db:
            if token is None:
                plan = repository.read(db, slug).plan
                return recruitment.described(plan.recruitment, "technical")
            session = lookup.find(app, db, token, even_expired=True)
            if session.mode != LIVE:
                return None
            plan = repository.stored_plan(session.plan)
            all_answered = session.stage in (Stage.DEBRIEF, Stage.COMPLETED)
            outcome: Outcome = "completed" if all_answered else "technical"
            return recruitment.described(
                plan.recruitment, outcome, completion.ids_of(db, session.participant_id)
            )
    except Exception:
        # Whatever the cause: fall back to the cached plan.
        log.exception("the way back of somebody in the study %r could not be looked up", slug)
        with _lock:
            known = _last_plans.get(slug)
        return recruitment.described(known.recruitment, "technical") if known is not None else None
