"""The page of one study: how it stands, live."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response, StreamingResponse

from app.services import access, entry_links, modes
from app.services.access import Right
from app.services.export import TABLES
from app.services.quality import LABELS, RULES
from app.services.studies import StudyInfo
from app.services.studio import Studio
from app.services.watching import overview as watching
from app.services.watching.stamp import stamp

from .desk import DataOf, DesignOf, SignedIn
from .live import Streams, changes, event_stream
from .own_address import base_url
from .security import StudioDep, signed_in_now
from .study_frame import study_page
from .templating import page

router = APIRouter(include_in_schema=False)

#: When a page that found too many others open may ask again.
_COME_BACK = timedelta(seconds=10)

MODES = (*modes.ALL, "all")


def mode_of(mode: str) -> str:
    """The mode that was asked for; live where it is none."""
    return mode if mode in MODES else "live"


@router.get("/studies/{slug}")
def overview(
    study: DesignOf, request: Request, studio: StudioDep, caller: SignedIn, mode: str = "live"
) -> Response:
    if Right.DATA not in access.rights(studio, caller, study.slug):
        return RedirectResponse(f"/studies/{study.slug}/plan", status_code=303)
    mode = mode_of(mode)
    export = f"/api/v1/studies/{study.slug}/export"
    return study_page(
        request,
        studio,
        caller,
        study,
        "overview",
        more={
            "participant_url": f"{base_url(request)}/s/{study.slug}",
            "links": (
                entry_links.counts(studio, study.id) if entry_links.wanted(study.plan) else None
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
        **_shown(studio, study, mode),
    )


@router.get("/studies/{slug}/live")
def live(study: DataOf, request: Request, studio: StudioDep, mode: str = "live") -> HTMLResponse:
    """The part of the page that changes, for a page that is open already."""
    shown = {"study": {"slug": study.slug}, **_shown(studio, study, mode_of(mode))}
    return page(request, "experimenter/_watching.html", shown)


@router.get("/studies/{slug}/events")
async def events(
    study: DataOf,
    request: Request,
    studio: StudioDep,
    caller: SignedIn,
    mode: str = "live",
    known: str | None = None,
    last_event_id: Annotated[str | None, Header()] = None,
) -> StreamingResponse:
    """An event whenever something of the page has changed since the stamp that it knows."""
    modes = watching.modes_of(mode_of(mode))
    stopping: Callable[[], bool] = request.app.state.stopping
    streams: Streams = request.app.state.streams
    ended = streams.opened(caller.account_id, studio.now() + _COME_BACK)

    def now() -> str | None:
        # Signed out, disabled or kept out since: nothing more is told.
        asking = signed_in_now(request)
        if asking is None or not access.may(studio, asking, study.slug, Right.DATA):
            return None
        return stamp(studio, study.id, modes, study.plan.lease_minutes)

    return event_stream(changes(now, last_event_id or known, stopping), ended)


def _shown(studio: Studio, study: StudyInfo, mode: str) -> dict[str, Any]:
    return {
        "mode": mode,
        "seen": watching.overview(studio, study, mode),
        "flag_labels": LABELS,
    }
