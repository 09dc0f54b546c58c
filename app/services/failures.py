"""What is due to somebody whom a fault of ours has stopped."""

from __future__ import annotations

import logging
from threading import Lock
from typing import Any

from cachetools import LRUCache

from app.study.plan import Plan
from app.study.protocol import Stage
from app.study.recruitment import Outcome

from . import recruitment, sessions, studies
from .modes import LIVE
from .studio import Studio

log = logging.getLogger(__name__)

#: Each study's plan as it was last seen: the way back is known even if the database is not there.
_last_plans: LRUCache[str, Plan] = LRUCache(studies.MAX_PLANS)
_lock = Lock()


def remember(slug: str, plan: Plan) -> None:
    with _lock:
        _last_plans[slug] = plan


def after_a_failure(studio: Studio, slug: str, token: str | None) -> dict[str, Any] | None:
    """The way back of somebody whom a fault of ours stopped.

    Whoever had given every answer has them all stored, and has completed the study as far as it
    was in their hands: theirs is the code of completion.
    """
    try:
        with studio.database.read() as session:
            if token is None:
                plan = studies.read(session, slug).plan
                return recruitment.described(plan, "technical")
            row = sessions.find(studio, session, token, even_expired=True)
            if row.mode != LIVE:
                return None
            plan = studies.stored_plan(row.plan)
            all_answered = row.stage in (Stage.DEBRIEF, Stage.COMPLETED)
            outcome: Outcome = "completed" if all_answered else "technical"
            return recruitment.described(
                plan, outcome, recruitment.ids_of(session, row.participant_id)
            )
    except Exception:
        # Whatever keeps us from looking the way back up: the person gets the one we remember.
        log.exception("the way back of somebody in the study %r could not be looked up", slug)
        with _lock:
            known = _last_plans.get(slug)
        return recruitment.described(known, "technical") if known is not None else None
