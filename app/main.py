"""The web application, assembled."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, Request
from fastapi.responses import RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.types import Scope

from app import __version__
from app.services import periodic_tasks
from app.services.settings import Settings
from app.services.studio import Studio, open_studio
from app.web import (
    account_pages,
    activity_pages,
    admin_pages,
    api,
    body_limit,
    data_pages,
    deleted_study_pages,
    desk,
    draft_pages,
    draft_settings_pages,
    entrances,
    ethics_pages,
    exports,
    faults_counted,
    guard,
    host_cookies,
    invitation_pages,
    job_pages,
    leaving_pages,
    live,
    manage_pages,
    media,
    overview_pages,
    participant_pages,
    people_pages,
    plan_pages,
    privacy_pages,
    problems,
    recruit_pages,
    request_log,
    results_pages,
    returning_pages,
    sign_in_pages,
    stage_pages,
    story_pages,
    study_pages,
    watched,
)
from app.web.templating import STATIC


class KeptStaticFiles(StaticFiles):
    """Static files whose address changes with their content may be kept for ever."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        named_by_content = b"v=" in scope["query_string"]
        response.headers["Cache-Control"] = (
            "public, max-age=31536000, immutable" if named_by_content else "no-cache"
        )
        return response


def create_app(
    settings: Settings | None = None,
    *,
    studio: Studio | None = None,
    closes_studio: bool | None = None,
) -> FastAPI:
    """The application over the studio of `settings`, or over one that is open already.

    closes_studio: whether the studio ends with the server; by default only one opened here does.
    """
    opened = studio or open_studio(settings or Settings())
    closes = studio is None if closes_studio is None else closes_studio

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        # With workers apart, theirs is one sweep for all servers; each has a memory of its own.
        apart = opened.settings.workers_apart
        with periodic_tasks.running(opened, of_the_studio=not apart):
            yield
        if closes:
            opened.close()

    app = FastAPI(
        title="PBPO Studio",
        version=__version__,
        description="Human evaluation studies by pairwise video choices.",
        lifespan=lifespan,
        # Their scripts come from other sites, which our pages' policy forbids.
        docs_url=None,
        redoc_url=None,
        # Addresses hold ids of people: they are for no collector that a machine may have set up.
        telemetry={"tracing": False, "metrics": False, "logs": False},
    )
    app.state.studio = opened
    # A server that is told to stop says so here, so that streams end before it waits for them.
    app.state.stopping = lambda: False
    app.state.streams = live.Streams()
    problems.install(app)
    deleted_study_pages.install(app)
    app.add_middleware(body_limit.BodyLimit)
    app.add_middleware(guard.Guard)
    app.add_middleware(host_cookies.HostCookies)
    app.add_middleware(faults_counted.FaultsCounted)
    app.add_middleware(request_log.RequestLog)
    app.add_exception_handler(desk.ToSignIn, _to_sign_in)
    app.mount("/static", KeptStaticFiles(directory=STATIC), name="static")
    for module in (
        watched,
        api,
        exports,
        media,
        participant_pages,
        stage_pages,
        leaving_pages,
        returning_pages,
        privacy_pages,
        sign_in_pages,
        invitation_pages,
        account_pages,
        admin_pages,
        activity_pages,
        people_pages,
        ethics_pages,
        draft_pages,
        draft_settings_pages,
        job_pages,
        study_pages,
        plan_pages,
        manage_pages,
        recruit_pages,
        data_pages,
        overview_pages,
        results_pages,
        story_pages,
    ):
        app.include_router(module.router)
    # The pages of evaluators again, for sessions that do not count.
    for prefix in entrances.PREFIXES.values():
        for pages in (participant_pages, stage_pages, leaving_pages, privacy_pages):
            app.include_router(pages.router, prefix=prefix)
    return app


async def _to_sign_in(_request: Request, error: Exception) -> Response:
    assert isinstance(error, desk.ToSignIn)
    return RedirectResponse(error.location, status_code=303)
