"""The layout of all pages of a study: title, status, and tabs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from fastapi import Request
from fastapi.responses import Response

from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.studies import access
from app.services.studies.access import Right
from app.services.studies.repository import StudyInfo

from .page_context import experimenter_page


class Place(NamedTuple):
    """A tab of a study's pages, and the right that it requires."""

    key: str
    path: str
    label: str
    right: Right


PLACES: Final = (
    Place("overview", "", "Overview", Right.DATA),
    Place("results", "/results", "Results", Right.DATA),
    Place("data", "/data", "Data", Right.DATA),
    Place("recruit", "/recruit", "Recruit", Right.CHANGE),
    Place("machines", "/machines", "Machines", Right.CHANGE),
    Place("manage", "/manage", "Manage", Right.CHANGE),
    Place("plan", "/plan", "Plan", Right.DESIGN),
    Place("ethics", "/ethics", "Ethics", Right.DESIGN),
    Place("people", "/people", "People", Right.DATA),
    Place("activity", "/activity", "Activity", Right.DATA),
)


def study_page(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    here: str,
    more: Mapping[str, Any] | None = None,
    status_code: int = 200,
    tab: str = "",
    **context: Any,
) -> Response:
    """A page of a study, from `templates/experimenter/study_<here>.html`.

    The template receives `study` (slug, title, status, paused, and `more`), the caller's `rights`,
    and the tabs that the caller may open.  tab: the tab that it is part of, if that is not `here`.
    """
    plan = study.plan
    title = plan.text(plan.title, plan.default_language)
    rights = access.rights(app, caller, study.slug)
    has_machines = any(one.is_machine for one in plan.environments.values())
    said = {
        "slug": study.slug,
        "title": title,
        "status": study.status,
        "paused": study.paused_at is not None,
        **(more or {}),
    }
    places = [
        {"key": place.key, "label": place.label, "url": f"/studies/{study.slug}{place.path}"}
        for place in PLACES
        if place.right in rights and (place.key != "machines" or has_machines)
    ]
    return experimenter_page(
        request,
        caller,
        f"experimenter/study_{here}.html",
        title,
        status_code=status_code,
        study=said,
        here=tab or here,
        places=places,
        rights=rights,
        **context,
    )
