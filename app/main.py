"""The web application, assembled."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager

from fastapi import FastAPI, Request
from fastapi.responses import RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.types import Scope

from app import __version__
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.maintenance import periodic_tasks
from app.services.rollouts import crane_machine
from app.services.runtime.settings import Settings
from app.services.sessions import box_queries
from app.web.api import (
    export_routes,
    machine_calls,
    machine_program,
    rollout_routes,
    session_routes,
    work_polling,
)
from app.web.evaluator import (
    deleted_study_pages,
    entry_pages,
    leaving_pages,
    media,
    privacy_pages,
    re_entry_pages,
    stage_pages,
    trouble_pages,
)
from app.web.experimenter import (
    account_pages,
    activity_pages,
    admin_pages,
    data_pages,
    desk_pages,
    draft_pages,
    draft_settings_pages,
    ethics_pages,
    invitation_pages,
    job_pages,
    machine_pages,
    manage_pages,
    overview_pages,
    page_context,
    people_pages,
    people_results_pages,
    plan_pages,
    recruit_pages,
    results_pages,
    session_detail_pages,
    sign_in_pages,
    study_list_pages,
)
from app.web.http import (
    body_limit,
    failure_middleware,
    head_requests,
    health_routes,
    host_cookies,
    older_browsers,
    problems,
    request_guard,
    request_log,
    root_path,
    server_sent_events,
    session_paths,
)
from app.web.http.known_parameters import KnownParameters
from app.web.http.templating import STATIC


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
    app: AppContext | None = None,
    closes_studio: bool | None = None,
) -> FastAPI:
    """The application over the studio of `settings`, or over one that is open already.

    closes_studio: whether the studio ends with the server; by default only one opened here does.
    """
    opened = app or open_app(settings or Settings())
    closes = app is None if closes_studio is None else closes_studio

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        # With workers apart, theirs is one sweep for all servers; each has a memory of its own.
        apart = opened.settings.workers_apart
        box_queries.load_if_used(opened)
        with ExitStack() as running:
            running.enter_context(periodic_tasks.running(opened, of_the_studio=not apart))
            if not apart:
                running.enter_context(crane_machine.running(opened))
            yield
        if closes:
            opened.close()

    fastapi_app = FastAPI(
        title="PBPO Studio",
        version=__version__,
        description="Human evaluation studies by pairwise video choices.",
        lifespan=lifespan,
        # Their scripts come from other sites, which our pages' policy forbids.
        docs_url=None,
        redoc_url=None,
        servers=[{"url": root}] if (root := opened.settings.root_path) else None,
        # Addresses hold ids of people: they are for no collector that a machine may have set up.
        telemetry={"tracing": False, "metrics": False, "logs": False},
    )
    fastapi_app.state.app = opened
    # A server that is told to stop says so here, so that streams end before it waits for them.
    fastapi_app.state.stopping = lambda: False
    fastapi_app.state.streams = server_sent_events.Streams()
    fastapi_app.state.work_polling = work_polling.WorkPolling()
    fastapi_app.state.machine_calls = machine_calls.CallLimit()
    problems.install(fastapi_app)
    deleted_study_pages.install(fastapi_app)
    fastapi_app.add_middleware(head_requests.HeadRequests)
    fastapi_app.add_middleware(body_limit.BodyLimit)
    fastapi_app.add_middleware(request_guard.Guard)
    fastapi_app.add_middleware(host_cookies.HostCookies)
    fastapi_app.add_middleware(failure_middleware.FailureMiddleware)
    fastapi_app.add_middleware(request_log.RequestLog)
    fastapi_app.add_middleware(root_path.RootPath)
    fastapi_app.add_exception_handler(page_context.ToSignIn, _to_sign_in)
    fastapi_app.mount("/static", KeptStaticFiles(directory=STATIC), name="static")
    # Platforms, mail programs and monitors add parameters of theirs to the addresses of these.
    for module in (
        health_routes,
        older_browsers,
        media,
        entry_pages,
        stage_pages,
        leaving_pages,
        re_entry_pages,
        privacy_pages,
        trouble_pages,
        sign_in_pages,
        invitation_pages,
    ):
        fastapi_app.include_router(module.router)
    for module in (
        session_routes,
        export_routes,
        rollout_routes,
        machine_program,
        account_pages,
        admin_pages,
        activity_pages,
        people_pages,
        people_results_pages,
        ethics_pages,
        draft_pages,
        draft_settings_pages,
        job_pages,
        study_list_pages,
        plan_pages,
        desk_pages,
        machine_pages,
        manage_pages,
        recruit_pages,
        data_pages,
        overview_pages,
        results_pages,
        session_detail_pages,
    ):
        fastapi_app.include_router(module.router, dependencies=[KnownParameters])
    # The pages of evaluators again, for sessions that do not count.
    for prefix in session_paths.PREFIXES.values():
        for pages in (entry_pages, stage_pages, leaving_pages, privacy_pages, trouble_pages):
            fastapi_app.include_router(pages.router, prefix=prefix)
    root_path.require_unambiguous(fastapi_app, opened.settings)
    return fastapi_app


async def _to_sign_in(_request: Request, error: Exception) -> Response:
    assert isinstance(error, page_context.ToSignIn)
    return RedirectResponse(error.location, status_code=303)
