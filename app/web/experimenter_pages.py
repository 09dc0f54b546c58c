"""The pages of those who run studies."""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services import accounts, admission, entry_links, results, studies
from app.services.accounts import Experimenter
from app.services.errors import SignInRequiredError
from app.services.export import TABLES
from app.services.state import ENDED

from .security import (
    FORM_COOKIE,
    SIGN_IN_COOKIE,
    MaybeExperimenterDep,
    StudioDep,
    check_form_token,
    form_token,
    new_form_secret,
    session_cookie,
    set_cookie,
)
from .templating import page

router = APIRouter(include_in_schema=False)

_MODES = ("live", "preview", "simulated", "all")


class ToSignIn(Exception):  # noqa: N818 - not a fault: a way to go
    """A page was asked for by somebody who is not signed in."""

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.location = f"/sign-in?next={quote(path)}"


def signed_in(request: Request, caller: MaybeExperimenterDep) -> Experimenter:
    if caller is None:
        raise ToSignIn(request.url.path)
    return caller


SignedIn = Annotated[Experimenter, Depends(signed_in)]


@router.get("/")
def home() -> Response:
    return RedirectResponse("/studies", status_code=303)


@router.get("/sign-in")
def sign_in_page(
    request: Request,
    studio: StudioDep,
    next: str = "/studies",  # noqa: A002 - a field's name
) -> Response:
    return _sign_in_page(request, studio, next, None)


@router.post("/sign-in")
def sign_in(
    request: Request,
    studio: StudioDep,
    email: Annotated[str, Form(max_length=254)],
    password: Annotated[str, Form(max_length=1000)],
    csrf_token: Annotated[str, Form()],
    next: Annotated[str, Form()] = "/studies",  # noqa: A002
) -> Response:
    check_form_token(request, csrf_token)
    try:
        token = accounts.sign_in(studio, email, password)
    except SignInRequiredError:
        return _sign_in_page(
            request, studio, next, "That address and password do not belong together.", status=401
        )
    response = RedirectResponse(_own_path(next), status_code=303)
    set_cookie(
        response,
        studio,
        SIGN_IN_COOKIE,
        token,
        max_age=int(accounts.SIGN_IN_LASTS.total_seconds()),
    )
    return response


@router.post("/sign-out")
def sign_out(request: Request, studio: StudioDep, csrf_token: Annotated[str, Form()]) -> Response:
    check_form_token(request, csrf_token)
    accounts.sign_out(studio, request.cookies.get(SIGN_IN_COOKIE, ""))
    response = RedirectResponse("/sign-in", status_code=303)
    response.delete_cookie(SIGN_IN_COOKIE)
    return response


@router.get("/studies")
def all_studies(request: Request, studio: StudioDep, caller: SignedIn) -> Response:
    counts = results.counts(studio)
    nobody = results.Counts()
    lines = [
        {
            "slug": study.slug,
            "title": study.plan.text(study.plan.title, study.plan.default_language),
            "status": study.status,
            "sessions_live": counts.get((study.slug, "live"), nobody).total,
            "completed_live": counts.get((study.slug, "live"), nobody).completed,
            "created_at": study.created_at,
            "plan_hash": study.plan_hash,
        }
        for study in studies.all_studies(studio)
    ]
    return _page(request, caller, "experimenter/studies.html", "Studies", studies=lines)


@router.get("/studies/{slug}")
def one_study(
    slug: str, request: Request, studio: StudioDep, caller: SignedIn, mode: str = "live"
) -> Response:
    mode = mode if mode in _MODES else "live"
    study = studies.find(studio, slug)
    plan = study.plan
    language = plan.default_language
    title = plan.text(plan.title, language)
    lines = results.sessions(studio, slug, None if mode == "all" else mode)
    stages = [line.stage for line in lines]
    ended = {stage: stages.count(stage) for stage in ENDED}
    export = f"/api/v1/studies/{slug}/export"
    return _page(
        request,
        caller,
        "experimenter/study.html",
        title,
        study={
            "slug": slug,
            "title": title,
            "status": study.status,
            "plan_hash": study.plan_hash,
            "plan_version": study.plan_version,
            "participant_url": f"{str(request.base_url).rstrip('/')}/s/{slug}",
            "links": entry_links.counts(studio, study.id) if entry_links.wanted(plan) else None,
            "conditions": [
                {
                    "name": condition.name,
                    "method": condition.method,
                    "environment": condition.environment,
                    "skip_label": condition.skip and plan.text(condition.skip.label, language),
                }
                for condition in plan.conditions
            ],
            "queries_per_trial": plan.queries_per_trial,
            "trials": plan.trials,
            "created_at": study.created_at,
            "opened_at": study.opened_at,
            "closed_at": study.closed_at,
            "payload_mb": results.payload_mb(studio, study),
        },
        counts={
            "active": len(lines) - sum(ended.values()),
            **ended,
            "deleted": results.deleted(studio, slug, None if mode == "all" else mode),
        },
        sessions=lines,
        tables=[
            {
                "name": table.name,
                "description": table.description,
                "url": f"{export}/{table.name}.csv?mode={mode}",
            }
            for table in TABLES.values()
        ],
        zip_url=f"{export}.zip?mode={mode}",
        mode=mode,
    )


@router.post("/studies/{slug}/open")
def open_study(
    slug: str,
    request: Request,
    studio: StudioDep,
    _caller: SignedIn,
    csrf_token: Annotated[str, Form()],
) -> Response:
    check_form_token(request, csrf_token)
    studies.open_study(studio, slug)
    return RedirectResponse(f"/studies/{slug}", status_code=303)


@router.post("/studies/{slug}/preview")
def preview(
    slug: str,
    request: Request,
    studio: StudioDep,
    _caller: SignedIn,
    csrf_token: Annotated[str, Form()],
) -> Response:
    """Go through the study as an evaluator would; its data is marked, and left out of results."""
    check_form_token(request, csrf_token)
    token, _ = admission.start(studio, slug, mode=admission.PREVIEW, by_experimenter=True)
    response = RedirectResponse(f"/s/{slug}", status_code=303)
    set_cookie(response, studio, session_cookie(slug), token)
    return response


@router.post("/studies/{slug}/close")
def close_study(
    slug: str,
    request: Request,
    studio: StudioDep,
    _caller: SignedIn,
    csrf_token: Annotated[str, Form()],
) -> Response:
    check_form_token(request, csrf_token)
    studies.close_study(studio, slug)
    return RedirectResponse(f"/studies/{slug}", status_code=303)


def _sign_in_page(
    request: Request, studio: Any, following: str, error: str | None, status: int = 200
) -> Response:
    fresh = None
    if FORM_COOKIE not in request.cookies and SIGN_IN_COOKIE not in request.cookies:
        fresh = new_form_secret()
        request.cookies[FORM_COOKIE] = fresh
    response = page(
        request,
        "experimenter/sign_in.html",
        {
            "page_title": "Sign in",
            "error": error,
            "next": _own_path(following),
            "csrf_token": form_token(request),
            "experimenter": None,
        },
        status_code=status,
    )
    if fresh is not None:
        set_cookie(response, studio, FORM_COOKIE, fresh)
    return response


def _own_path(path: str) -> str:
    """The path if it is one of ours: nobody is sent to another site after signing in."""
    is_own = path.startswith("/") and not path.startswith(("//", "/\\"))
    return path if is_own else "/studies"


def _page(
    request: Request, caller: Experimenter, template: str, title: str, **context: Any
) -> Response:
    values = {
        "page_title": title,
        "email": caller.email,
        "experimenter": caller,
        "csrf_token": form_token(request),
        **context,
    }
    return page(request, template, values)
