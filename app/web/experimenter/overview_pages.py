"""The overview page of a study, updated live."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response, StreamingResponse

from app.services.arrival import entry_links
from app.services.context import AppContext
from app.services.export import TABLES
from app.services.monitoring import overview as watching
from app.services.monitoring.change_token import change_token
from app.services.monitoring.data_quality import LABELS, RULES
from app.services.studies import access, session_modes
from app.services.studies.access import Right
from app.services.studies.repository import StudyInfo
from app.web.http.public_address import base_url
from app.web.http.security import AppDep, signed_in_now
from app.web.http.server_sent_events import Streams, changes, event_stream
from app.web.http.templating import page

from .page_context import DataOf, DesignOf, SignedIn
from .study_frame import study_page

router = APIRouter(include_in_schema=False)

#: When a page refused for too many open streams may try again.
_COME_BACK = timedelta(seconds=10)

MODES = (*session_modes.ALL, "all")


def mode_of(mode: str) -> str:
    """The requested mode; live if it is unknown."""
    return mode if mode in MODES else "live"


@router.get("/studies/{slug}")
def overview(
    study: DesignOf, request: Request, app: AppDep, caller: SignedIn, mode: str = "live"
) -> Response:
    """The overview page."""
    if Right.DATA not in access.rights(app, caller, study.slug):
        return RedirectResponse(f"/studies/{study.slug}/plan", status_code=303)
    mode = mode_of(mode)
    export = f"/api/v1/studies/{study.slug}/export"
    return study_page(
        request,
        app,
        caller,
        study,
        "overview",
        more={
            "participant_url": f"{base_url(request)}/s/{study.slug}",
            "links": (
                entry_links.counts(app, study.id) if entry_links.required(study.plan) else None
            ),
        },
        tables=[
            {
                "name": table.name,
                "description": table.description,
                "url": f"{export}/{table.name}.csv?mode={mode}",
            }
            for table in TABLES.values()
        ],
        zip_url=f"{export}.zip?mode={mode}",
        flag_rules=[(LABELS[flag], rule) for flag, rule in RULES.items()],
        **_shown(app, study, mode),
    )


@router.get("/studies/{slug}/live")
def live(study: DataOf, request: Request, app: AppDep, mode: str = "live") -> HTMLResponse:
    """The part of the page that changes, for a page that is already open."""
    shown = {"study": {"slug": study.slug}, **_shown(app, study, mode_of(mode))}
    return page(request, "experimenter/_watching.html", shown)


@router.get("/studies/{slug}/events")
async def events(
    study: DataOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    mode: str = "live",
    known: str | None = None,
    last_event_id: Annotated[str | None, Header()] = None,
) -> StreamingResponse:
    """An event stream with an event whenever the page's data has changed since its change token."""
    modes = watching.modes_of(mode_of(mode))
    stopping: Callable[[], bool] = request.app.state.stopping
    streams: Streams = request.app.state.streams
    ended = streams.opened(caller.account_id, app.now() + _COME_BACK)

    def now() -> str | None:
        # Signed out, disabled or without access by now: the stream ends.
        asking = signed_in_now(request)
        if asking is None or not access.may(app, asking, study.slug, Right.DATA):
            return None
        return change_token(app, study.id, modes, study.plan.lease_minutes)

    return event_stream(changes(now, last_event_id or known, stopping), ended)


def _shown(app: AppContext, study: StudyInfo, mode: str) -> dict[str, Any]:
    return {
        "mode": mode,
        "seen": watching.overview(app, study, mode),
        "flag_labels": LABELS,
    }
