"""Who may do what with a study: roles, ownership and sharing, checked in one place.

An admin may do everything. An experimenter may do everything with studies of their own, and all but
share and delete with those shared with them; other people's do not exist for them. A reviewer
reads every study's design, and no data.
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
    """What may be done with a study."""

    DESIGN = "see the design of"
    DATA = "see the data of"
    IDENTITIES = "see the platforms' ids of"
    CHANGE = "change"
    OWN = "share or delete"


#: What each kind of membership to a study allows.
_ALLOWS: dict[str, frozenset[Right]] = {
    Role.ADMIN: frozenset(Right),
    Role.REVIEWER: frozenset({Right.DESIGN}),
    repository.OWNER: frozenset(Right),
    repository.SHARED: frozenset({Right.DESIGN, Right.DATA, Right.IDENTITIES, Right.CHANGE}),
}


def study_for(app: AppContext, caller: Principal, slug: str, right: Right) -> repository.StudyInfo:
    """The study, if the caller has this right.

    Raises NotFoundError if it does not exist for the caller, ForbiddenError if it does.
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
    """Every study that exists for the caller, the newest first."""
    with app.database.read() as db:
        mine = set(
            db.scalars(
                select(StudyAccess.study_id).where(StudyAccess.account_id == caller.account_id)
            )
        )
    everything = caller.role in (Role.ADMIN, Role.REVIEWER)
    return [info for info in repository.all_studies(app) if everything or info.id in mine]


def may(app: AppContext, caller: Principal, slug: str, right: Right) -> bool:
    """Whether the caller has this right to the study, with what they show."""
    try:
        study_for(app, caller, slug, right)
    except (NotFoundError, ForbiddenError):
        return False
    return True


def rights(app: AppContext, caller: Principal, slug: str) -> frozenset[Right]:
    """All that the caller may do with this study: for pages that show only what can be done."""
    with app.database.read() as db:
        return _rights_of(db, caller, repository.read(db, slug).id)


def may_change(db: Session, caller: Principal, study_id: int) -> bool:
    """Whether the caller may change this study: for use cases within their own transaction."""
    return Right.CHANGE in _rights_of(db, caller, study_id)


def may_make_studies(caller: Principal) -> bool:
    """Whether the caller may set studies up."""
    return caller.role is not Role.REVIEWER and caller.scope is Scope.WRITE


def _rights_of(db: Session, caller: Principal, study_id: int) -> frozenset[Right]:
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
    if right is Right.IDENTITIES and caller.scope is Scope.READ:
        raise ForbiddenError(
            "expected an API token of the scope identities or write, and this one may only read"
        )
    if right in (Right.CHANGE, Right.OWN) and caller.scope is not Scope.WRITE:
        raise ForbiddenError("expected an API token of the scope write, and this one may only read")
