"""Access control for studies: roles, ownership and sharing, checked in one place.

An admin has every right. An experimenter has every right to their own studies, and all but sharing
and deletion to those shared with them; other studies do not exist for them. A reviewer may read the
design of every study, and no data.
"""

from __future__ import annotations

from enum import StrEnum

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.accounts.accounts import Principal, Role, Scope
from app.services.context import AppContext
from app.services.runtime.errors import ForbiddenError, NotFoundError
from app.storage.models.accounts import StudyAccess

from . import repository


class Right(StrEnum):
    """A right to a study."""

    DESIGN = "see the design of"
    DATA = "see the data of"
    IDENTITIES = "see the platforms' ids of"
    CHANGE = "change"
    OWN = "share or delete"


#: The rights that each role and each kind of membership gives.
_ALLOWS: dict[str, frozenset[Right]] = {
    Role.ADMIN: frozenset(Right),
    Role.REVIEWER: frozenset({Right.DESIGN}),
    repository.OWNER: frozenset(Right),
    repository.SHARED: frozenset({Right.DESIGN, Right.DATA, Right.IDENTITIES, Right.CHANGE}),
}


def study_for(app: AppContext, caller: Principal, slug: str, right: Right) -> repository.StudyInfo:
    """The study, if the caller has this right.

    Raises NotFoundError if the study does not exist for the caller, and ForbiddenError if it does
    but the right, or the scope of the caller's token, is missing.
    """
    with app.database.read() as db:
        info = repository.read(db, slug)
        held = _rights_of(db, caller, info.id)
    if not held:
        raise NotFoundError(f"there is no study named {slug!r}")
    if right not in held:
        raise ForbiddenError(f"{caller.email} ({caller.role.value}) may not {right.value} {slug!r}")
    _check_scope(caller, right)
    return info


def studies_for(app: AppContext, caller: Principal) -> list[repository.StudyInfo]:
    """All studies that exist for the caller, the newest first."""
    with app.database.read() as db:
        mine = set(
            db.scalars(
                select(StudyAccess.study_id).where(StudyAccess.account_id == caller.account_id)
            )
        )
    everything = caller.role in (Role.ADMIN, Role.REVIEWER)
    return [info for info in repository.all_studies(app) if everything or info.id in mine]


def may(app: AppContext, caller: Principal, slug: str, right: Right) -> bool:
    """Whether the caller has this right to the study, the scope of their token included."""
    try:
        study_for(app, caller, slug, right)
    except (NotFoundError, ForbiddenError):
        return False
    return True


def rights(app: AppContext, caller: Principal, slug: str) -> frozenset[Right]:
    """The caller's rights to this study, for pages that show only permitted actions."""
    with app.database.read() as db:
        return _rights_of(db, caller, repository.read(db, slug).id)


def may_change(db: Session, caller: Principal, study_id: int) -> bool:
    """Whether the caller may change this study, within the transaction of `db`."""
    return Right.CHANGE in _rights_of(db, caller, study_id)


def may_make_studies(caller: Principal) -> bool:
    """Whether the caller may create studies."""
    return caller.role is not Role.REVIEWER and caller.scope is Scope.WRITE


def _rights_of(db: Session, caller: Principal, study_id: int) -> frozenset[Right]:
    """The rights that the caller's role and membership give to this study."""
    by_role = _ALLOWS.get(caller.role, frozenset())
    membership = db.scalar(
        select(StudyAccess.access).where(
            StudyAccess.study_id == study_id, StudyAccess.account_id == caller.account_id
        )
    )
    if membership is None or caller.role is Role.REVIEWER:
        return by_role
    return by_role | _ALLOWS[membership]


def _check_scope(caller: Principal, right: Right) -> None:
    """Raise ForbiddenError if the right needs a wider scope than the caller's token has."""
    if right is Right.IDENTITIES and caller.scope is Scope.READ:
        raise ForbiddenError(
            "expected an API token of the scope identities or write, and this one may only read"
        )
    if right in (Right.CHANGE, Right.OWN) and caller.scope is not Scope.WRITE:
        raise ForbiddenError("expected an API token of the scope write, and this one may only read")
