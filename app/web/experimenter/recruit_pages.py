"""Recruitment: links per platform, personal links, capacity, and conditions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, get_args

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services.accounts.accounts import Principal
from app.services.arrival import capacity, entry_links, pilot_links
from app.services.context import AppContext
from app.services.monitoring.conditions import conditions
from app.services.runtime.errors import ConflictError
from app.services.studies import lifecycle
from app.services.studies.repository import StudyInfo
from app.study.recruitment import (
    NO_PLATFORM,
    OTHER,
    PLATFORMS,
    Outcome,
    Recruitment,
    study_link,
    way_back,
)
from app.web.http.public_address import base_url
from app.web.http.security import AppDep

from .page_context import ChangeOf, OwnForm, SignedIn
from .study_frame import study_page

router = APIRouter(include_in_schema=False)

LIVE = "live"
#: More than this many at once is for the command line, which writes them into a file.
MOST_LINKS = 500


@router.get("/studies/{slug}/recruit")
def recruit(study: ChangeOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The page of recruitment."""
    return _recruit(request, app, caller, study)


@router.post("/studies/{slug}/links", dependencies=[OwnForm])
def make_links(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    count: Annotated[int, Form(ge=1, le=MOST_LINKS)],
    label: Annotated[str, Form(max_length=100)] = "",
) -> Response:
    """Create personal links; this response is the only one that shows them."""
    try:
        paths = entry_links.create(app, study.slug, count, label.strip(), caller.email)
    except ConflictError as error:
        return _recruit(request, app, caller, study, refused=str(error))
    base = base_url(request)
    return _recruit(request, app, caller, study, made=[f"{base}{path}" for path in paths])


@router.post("/studies/{slug}/pilot/link", dependencies=[OwnForm])
def make_pilot_link(study: ChangeOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Create a pilot link; this response is the only one that shows it."""
    try:
        token = pilot_links.make_link(app, study.slug, caller.email)
    except ConflictError as error:
        return _recruit(request, app, caller, study, refused=str(error))
    path = pilot_links.path_of(study.slug, token)
    return _recruit(request, app, caller, study, pilot_link=f"{base_url(request)}{path}")


@router.post("/studies/{slug}/pilot/end", dependencies=[OwnForm])
def end_pilot_link(study: ChangeOf, app: AppDep, caller: SignedIn) -> Response:
    """Revoke the pilot link."""
    pilot_links.end_link(app, study.slug, caller.email)
    return RedirectResponse(f"/studies/{study.slug}/recruit", status_code=303)


@router.post("/studies/{slug}/conditions", dependencies=[OwnForm])
def switch(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    on: Annotated[list[str] | None, Form()] = None,
    was_off: Annotated[str | None, Form(max_length=10_000)] = None,
) -> Response:
    """Switch conditions on or off."""
    base = None if was_off is None else [name for name in was_off.split(",") if name]
    try:
        lifecycle.switch_conditions(app, study.slug, on or [], caller.email, base=base)
    except ConflictError as error:
        return _recruit(request, app, caller, study, refused=str(error))
    return RedirectResponse(f"/studies/{study.slug}/recruit", status_code=303)


def _recruit(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    *,
    refused: str | None = None,
    made: Sequence[str] = (),
    pilot_link: str | None = None,
) -> Response:
    with app.database.read() as db:
        has_pilot = pilot_links.has_link(db, study.id)
        taken = capacity.by_order(db, study, LIVE, app.now()).total()
    recruitment = study.plan.recruitment
    address = f"{base_url(request)}/s/{study.slug}"
    return study_page(
        request,
        app,
        caller,
        study,
        "recruit",
        status_code=200 if refused is None else 409,
        refused=refused,
        made=made,
        pilot_link=pilot_link,
        has_pilot=has_pilot,
        most_links=MOST_LINKS,
        platform=recruitment.label,
        links=_links(recruitment, address),
        single_use=(
            entry_links.counts(app, study.id) if entry_links.required(study.plan) else None
        ),
        ways_back=list(_ways_back(recruitment)),
        taken=taken,
        wanted=study.plan.places,
        # No name of a condition has a comma; one behind each, so that none is not an empty field.
        was_off="".join(f"{name}," for name in study.conditions_off) or ",",
        conditions=[
            line
            for line in conditions(app, study, [LIVE])
            if line.name in {condition.name for condition in study.plan.conditions}
        ],
    )


def _links(recruitment: Recruitment, address: str) -> list[dict[str, Any]]:
    """The link for each platform; the plan's own platform comes first."""
    labels = {NO_PLATFORM: "A link of your own"}
    labels |= {name: platform.label for name, platform in PLATFORMS.items()}
    if recruitment.platform == OTHER:
        labels[OTHER] = recruitment.label or OTHER
    added = {
        "connect": "Connect adds its parameters to it.",
        "mturk": "Mechanical Turk adds its parameters to it, as an external question.",
        "prolific": "Choose the address parameters when you set the study up at Prolific.",
        "sona": "SONA fills the survey code in.",
        "other": "In place of ${...} comes what the other site puts there, such as piped text.",
    }
    names = sorted(labels, key=lambda name: name != recruitment.platform)
    return [
        {
            "key": name,
            "label": labels[name],
            "address": study_link(name, address, _parameters(recruitment, name)),
            "note": added.get(name, ""),
            "is_chosen": name == recruitment.platform,
        }
        for name in names
    ]


def _parameters(recruitment: Recruitment, platform: str) -> tuple[str, ...]:
    return (recruitment.parameter,) if platform == "sona" else recruitment.parameters


def _ways_back(recruitment: Recruitment) -> Any:
    # Of one's own parameters, their names in braces stand in their places.
    names = {name: f"{{{name}}}" for name in recruitment.parameters}
    for outcome in get_args(Outcome):
        way = way_back(recruitment, outcome, names)
        if way is not None:
            yield {"outcome": outcome.replace("_", " "), "code": way.code, "url": way.url}
