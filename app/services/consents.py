"""Consents: their text with its version, and whose consent a changed text asks for anew."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from functools import lru_cache
from typing import Any

from sqlalchemy import Select, bindparam, select
from sqlalchemy.orm import Session, object_session

from app.storage.consent_tables import ConsentRow
from app.storage.tables import PlanVersion, SessionRow
from app.study import protocol, texts
from app.study.protocol import FINAL_STAGES, Stage

from .studies import stored_texts

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
    return texts.render(markdown)


def text(written: Mapping[str, str]) -> dict[str, Any]:
    """The consent of one language, with the version that an agreement has to name."""
    markdown = written["consent"]
    return {"version": texts.consent_version(markdown), "html": _rendered(markdown)}


def due(session: Session, row: SessionRow) -> PlanVersion | None:
    """The newest version of the plan, if this session's person has not agreed to its consent.

    A session that began under an earlier version keeps that version's other texts: only a consent
    is asked for again, and the session then goes on, under the newest version, where it was.
    """
    if row.stage in FINAL_STAGES:
        return None
    # Whoever looked a session up by its token has asked for it by the way.
    newest = row.newest_plan_id or session.scalar(_NEWEST, {"study_id": row.study_id})
    if newest == row.plan_id:
        return None
    version = session.get_one(PlanVersion, newest)
    wanted = text(stored_texts(version)[row.language])["version"]
    return version if row.stage == Stage.CONSENT or wanted != row.consent_version else None


def require_none_due(row: SessionRow) -> None:
    """Raises OutOfOrder if the person has to agree to a changed text before they go on."""
    session = object_session(row)
    if session is not None and row.stage != Stage.CONSENT and due(session, row) is not None:
        raise protocol.OutOfOrder(Stage.CONSENT, "the consent has changed, and is asked for again")


def renew(row: SessionRow, version: PlanVersion, given: str) -> None:
    """Go on under `version`, whose consent is agreed to: the session keeps its place.

    What was answered before stays under the version that it was answered under. Raises
    StaleConsent.
    """
    in_force = text(stored_texts(version)[row.language])["version"]
    if given != in_force:
        raise protocol.StaleConsent(in_force, given)
    row.plan = version


def agree(session: Session, row: SessionRow, version: str, now: datetime) -> None:
    """Keep the agreement to the consent of the plan that the session is under; earlier ones stay.

    The session's own columns say what its last agreement was.
    """
    session.flush()  # which version of the plan that is
    session.add(
        ConsentRow(session_id=row.id, plan_id=row.plan_id, consent_version=version, agreed_at=now)
    )
    row.consent_version = version
    row.consented_at = now
