"""Which sessions an export leaves out: checked, worked out by their flags, and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.monitoring import data_quality
from app.services.monitoring.data_quality import Flag
from app.services.runtime.errors import ConflictError
from app.services.studies.session_modes import ALL, LIVE

from .table import Request

#: Every flag: what "leave flagged sessions out" stands for.
ALL_FLAGS = tuple(Flag)


def modes_of(chosen: Sequence[str] | None) -> tuple[str, ...]:
    """The modes that count: live, unless others are asked for."""
    if not chosen:
        return (LIVE,)
    return ALL if "all" in chosen else tuple(dict.fromkeys(chosen))


def settled(app: AppContext, request: Request) -> Request:
    """The request with the sessions that its flags leave out.

    Raises ConflictError for a condition that the study does not have, and days out of order.
    """
    known = [condition.name for condition in request.study.plan.conditions]
    unknown = [name for name in request.conditions if name not in known]
    if unknown:
        raise ConflictError(f"expected conditions among {', '.join(known)}, got {unknown[0]!r}")
    if request.since and request.until and request.until < request.since:
        raise ConflictError(
            f"expected a last day on or after the first, {request.since}, got {request.until}"
        )
    if not request.without:
        return request
    with app.database.read() as db:
        return replace(request, left_out=_flagged(db, request))


def _flagged(db: Session, request: Request) -> tuple[int, ...]:
    found = data_quality.flags(db, request.study.id, request.modes)
    unwanted = set(request.without)
    return tuple(sorted(key for key, flags in found.items() if unwanted & set(flags)))


def in_words(request: Request) -> str:
    """What the request asks for, in a line: for the audit trail and the pages."""
    said = [f"mode: {', '.join(request.modes)}"]
    if request.conditions:
        said.append(f"conditions: {', '.join(request.conditions)}")
    if request.since is not None:
        said.append(f"begun from {request.since}")
    if request.until is not None:
        said.append(f"begun until {request.until}")
    if request.completed:
        said.append("completed only")
    if request.without:
        said.append(f"without the flags {', '.join(request.without)}")
    return "; ".join(said)
