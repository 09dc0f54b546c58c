"""Filters of an export: validated, with the flagged sessions resolved, and described in words."""

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

#: All flags, as "leave flagged sessions out" means.
ALL_FLAGS = tuple(Flag)


def modes_of(chosen: Sequence[str] | None) -> tuple[str, ...]:
    """The requested modes; live sessions only by default."""
    if not chosen:
        return (LIVE,)
    return ALL if "all" in chosen else tuple(dict.fromkeys(chosen))


def resolve_flags(app: AppContext, request: Request) -> Request:
    """The request with `left_out` set to the sessions that its flags exclude, and the process's
    summaries of people.

    Raises ConflictError for an unknown condition, and for dates in the wrong order.
    """
    known = [condition.name for condition in request.study.plan.conditions]
    unknown = [name for name in request.conditions if name not in known]
    if unknown:
        raise ConflictError(f"expected conditions among {', '.join(known)}, got {unknown[0]!r}")
    if request.since and request.until and request.until < request.since:
        raise ConflictError(
            f"expected a last day on or after the first, {request.since}, got {request.until}"
        )
    request = replace(request, people=app.proposer.people)
    if not request.without:
        return request
    with app.database.read() as db:
        return replace(request, left_out=_flagged(db, request))


def _flagged(db: Session, request: Request) -> tuple[int, ...]:
    found = data_quality.flags(db, request.study.id, request.modes)
    unwanted = set(request.without)
    return tuple(sorted(key for key, flags in found.items() if unwanted & set(flags)))


def in_words(request: Request) -> str:
    """The filters in one line, for the audit trail and the pages."""
    said = [f"mode: {', '.join(request.modes)}"]
    if request.participants:
        # The trail outlives a deletion, so it holds no pseudonym.
        said.append(f"one person, as {len(request.participants)} participant(s)")
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
