"""Consents: their text with its version, and whether a changed text needs a new agreement."""

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
from app.study import stages
from app.study.stages import FINAL_STAGES, Stage

#: Trial index and query index of an event that belongs to no trial.
NO_TRIAL = -1


def _newest_of(study_id: Any) -> Select[Any]:
    return (
        select(PlanVersion.id)
        .where(PlanVersion.study_id == study_id)
        .order_by(PlanVersion.version.desc())
        .limit(1)
    )


# Built once: one of them is part of every request of an evaluator.
_NEWEST = _newest_of(bindparam("study_id"))
#: The id of the newest plan version of the selected session's study: `SessionRow.newest_plan_id`.
NEWEST_OF_SESSION = _newest_of(SessionRow.study_id).correlate(SessionRow).scalar_subquery()


@lru_cache(maxsize=256)
def _rendered(markdown: str) -> str:
    return study_markdown.render(markdown)


def text(written: Mapping[str, str]) -> dict[str, Any]:
    """The consent of one language: its HTML, and the version that an agreement has to name.

    written: the texts of that language by name.
    """
    markdown = written["consent"]
    return {"version": study_markdown.consent_version(markdown), "html": _rendered(markdown)}


def due(db: Session, session: SessionRow) -> PlanVersion | None:
    """The newest version of the plan if its consent differs from the one agreed to, else None.

    A session that started under an earlier version keeps that version's other texts. Only the
    consent is asked again, and then the session continues at the same point, under the newest
    version.
    """
    if session.stage in FINAL_STAGES:
        return None
    # `lookup.find` has selected it together with the session.
    newest = session.newest_plan_id or db.scalar(_NEWEST, {"study_id": session.study_id})
    if newest == session.plan_id:
        return None
    version = db.get_one(PlanVersion, newest)
    wanted = text(stored_texts(version)[session.language])["version"]
    return version if session.stage == Stage.CONSENT or wanted != session.consent_version else None


def require_none_due(row: SessionRow) -> None:
    """Raise OutOfOrder if the person has to agree to a changed consent before they continue."""
    session = object_session(row)
    if session is not None and row.stage != Stage.CONSENT and due(session, row) is not None:
        raise stages.OutOfOrder(Stage.CONSENT, "the consent has changed, and is asked for again")


def renew(session: SessionRow, version: PlanVersion, given: str) -> None:
    """Move the session to `version` after agreement to its consent; its progress stays the same.

    given: the version of the text that was agreed to. Earlier responses keep the plan version under
    which they were given. Raises StaleConsent if `given` is not the text of `version`.
    """
    in_force = text(stored_texts(version)[session.language])["version"]
    if given != in_force:
        raise stages.StaleConsent(in_force, given)
    session.plan = version


def agree(db: Session, session: SessionRow, version: str, now: datetime) -> None:
    """Store the agreement to the consent of the session's plan version; earlier ones are kept.

    The session's own columns hold its last agreement.
    """
    db.flush()  # sets session.plan_id
    db.add(
        ConsentRow(
            session_id=session.id, plan_id=session.plan_id, consent_version=version, agreed_at=now
        )
    )
    session.consent_version = version
    session.consented_at = now
