"""Consents: their text with its version, and whose consent a changed text asks for anew."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from functools import lru_cache
from typing import Any

from sqlalchemy import Select, bindparam, select
from sqlalchemy.orm import Session, object_session

from app.services.studies.repository import stored_texts
from app.storage.models.consents import ConsentRow
from app.storage.models.studies import PlanVersion, SessionRow
from app.study import markdown as study_markdown
from app.study import protocol
from app.study.protocol import FINAL_STAGES, Stage

#: Trial and query of an event that belongs to none.
NO_TRIAL = -1


def _newest_of(study_id: Any) -> Select[Any]:
    return (
        select(PlanVersion.id)
        .where(PlanVersion.study_id == study_id)
        .order_by(PlanVersion.version.desc())
        .limit(1)
    )


# Made once: one of them is asked with every request of an evaluator's.
_NEWEST = _newest_of(bindparam("study_id"))
#: Of a session that is read, the newest version of its study's plan: `SessionRow.newest_plan_id`.
NEWEST_OF_SESSION = _newest_of(SessionRow.study_id).correlate(SessionRow).scalar_subquery()


@lru_cache(maxsize=256)
def _rendered(markdown: str) -> str:
    return study_markdown.render(markdown)


def text(written: Mapping[str, str]) -> dict[str, Any]:
    """The consent of one language, with the version that an agreement has to name."""
    markdown = written["consent"]
    return {"version": study_markdown.consent_version(markdown), "html": _rendered(markdown)}


def due(db: Session, session: SessionRow) -> PlanVersion | None:
    """The newest version of the plan, if this session's person has not agreed to its consent.

    A session that began under an earlier version keeps that version's other texts: only a consent
    is asked for again, and the session then goes on, under the newest version, where it was.
    """
    if session.stage in FINAL_STAGES:
        return None
    # Whoever looked a session up by its token has asked for it by the way.
    newest = session.newest_plan_id or db.scalar(_NEWEST, {"study_id": session.study_id})
    if newest == session.plan_id:
        return None
    version = db.get_one(PlanVersion, newest)
    wanted = text(stored_texts(version)[session.language])["version"]
    return version if session.stage == Stage.CONSENT or wanted != session.consent_version else None


def require_none_due(row: SessionRow) -> None:
    """Raises OutOfOrder if the person has to agree to a changed text before they go on."""
    session = object_session(row)
    if session is not None and row.stage != Stage.CONSENT and due(session, row) is not None:
        raise protocol.OutOfOrder(Stage.CONSENT, "the consent has changed, and is asked for again")


def renew(session: SessionRow, version: PlanVersion, given: str) -> None:
    """Go on under `version`, whose consent is agreed to: the session keeps its place.

    What was answered before stays under the version that it was answered under. Raises
    StaleConsent.
    """
    in_force = text(stored_texts(version)[session.language])["version"]
    if given != in_force:
        raise protocol.StaleConsent(in_force, given)
    session.plan = version


def agree(db: Session, session: SessionRow, version: str, now: datetime) -> None:
    """Keep the agreement to the consent of the plan that the session is under; earlier ones stay.

    The session's own columns say what its last agreement was.
    """
    db.flush()  # which version of the plan that is
    db.add(
        ConsentRow(
            session_id=session.id, plan_id=session.plan_id, consent_version=version, agreed_at=now
        )
    )
    session.consent_version = version
    session.consented_at = now
