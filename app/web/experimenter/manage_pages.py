"""Managing a study: preview, open, pause, close, revise, copy, delete."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Form, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse, Response

from app.services import jobs
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.drafts import drafts
from app.services.rollouts import pace
from app.services.runtime.errors import ChangedMeanwhileError, ConflictError
from app.services.studies import (
    lifecycle,
    opening,
    people_power,
    repository,
    revision,
    session_modes,
    simulation_results,
)
from app.services.studies.repository import StudyInfo
from app.statistics.power import MOST_PEOPLE
from app.study.text_diff import difference
from app.study.validation_errors import StudyFaults, in_lines
from app.web.http import languages, session_paths
from app.web.http.security import AppDep

from .page_context import ChangeOf, OwnerOf, OwnForm, SignedIn
from .study_frame import study_page

router = APIRouter(include_in_schema=False)


@router.get("/studies/{slug}/manage")
def manage(study: ChangeOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The page of these actions."""
    return _manage(request, app, caller, study)


@router.post("/studies/{slug}/preview", dependencies=[OwnForm])
def preview(study: ChangeOf, language: Annotated[str, Form(max_length=12)] = "") -> Response:
    """Begin a preview session in this language, from the first page.

    Its data is marked as preview and left out of results.
    """
    query = f"?{languages.PARAMETER}={language}" if language in study.plan.languages else ""
    address = f"{session_paths.PREFIXES[session_modes.PREVIEW]}/s/{study.slug}{query}"
    response = RedirectResponse(address, status_code=303)
    response.delete_cookie(session_paths.cookie_of(session_modes.PREVIEW, study.slug))
    return response


@router.get("/studies/{slug}/open")
def ask_to_open(study: ChangeOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The question whether to open a draft, with the doubts about it."""
    if study.status != repository.DRAFT:
        return _to(study, "/manage")
    asked = in_lines(opening.doubts_before_opening(app, study))
    asked += pace.slower_than_viewing(app, study)
    return study_page(request, app, caller, study, "open", doubts=asked)


@router.post("/studies/{slug}/open", dependencies=[OwnForm])
def open_study(study: ChangeOf, app: AppDep, caller: SignedIn) -> Response:
    """Open the study."""
    repository.open_study(app, study.slug, caller.email)
    return _to(study, "/manage")


@router.post("/studies/{slug}/close", dependencies=[OwnForm])
def close_study(study: ChangeOf, app: AppDep, caller: SignedIn) -> Response:
    """Close the study."""
    repository.close_study(app, study.slug, caller.email)
    return _to(study, "/manage")


@router.post("/studies/{slug}/pause", dependencies=[OwnForm])
def pause(study: ChangeOf, app: AppDep, caller: SignedIn) -> Response:
    """Pause the study."""
    lifecycle.pause(app, study.slug, caller.email)
    return _to(study, "/manage")


@router.post("/studies/{slug}/resume", dependencies=[OwnForm])
def resume(study: ChangeOf, app: AppDep, caller: SignedIn) -> Response:
    """Resume the study."""
    lifecycle.resume(app, study.slug, caller.email)
    return _to(study, "/manage")


@router.post("/studies/{slug}/clone", dependencies=[OwnForm])
def clone(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    new_slug: Annotated[str, Form(max_length=100)] = "",
) -> Response:
    """Create a draft from a copy. Without another slug it is meant to replace this draft."""
    try:
        draft = drafts.clone(app, caller, study, new_slug or study.slug)
    except ConflictError as error:
        return _manage(request, app, caller, study, str(error))
    return RedirectResponse(f"/drafts/{draft.public_id}", status_code=303)


@router.post("/studies/{slug}/delete", dependencies=[OwnForm])
def delete(
    study: OwnerOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    typed: Annotated[str, Form(max_length=100)] = "",
) -> Response:
    """Delete the study."""
    try:
        lifecycle.delete(app, study.slug, caller.email, typed=typed.strip())
    except ConflictError as error:
        return _manage(request, app, caller, study, str(error))
    return RedirectResponse("/studies", status_code=303)


@router.post("/studies/{slug}/simulate", dependencies=[OwnForm])
def simulate(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    sessions: Annotated[int, Form(ge=1, le=simulation_results.MOST_SESSIONS)],
    evaluator: Annotated[Literal["certain", "uncertain"], Form()],
    seed: Annotated[int, Form(ge=0, le=2**31 - 1)] = 0,
) -> Response:
    """Start a job that runs simulated sessions."""
    try:
        simulation_results.simulate(app, caller, study, sessions, evaluator, seed)
    except ConflictError as error:
        return _manage(request, app, caller, study, str(error))
    return _to(study, "/manage")


@router.post("/studies/{slug}/power", dependencies=[OwnForm])
def power(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    people: Annotated[str, Form(max_length=40)] = "",
    answers: Annotated[str, Form(max_length=40)] = "",
    own_share: Annotated[float, Form(ge=0, le=1)] = 0.3,
    within: Annotated[float, Form(ge=0, le=1)] = 0.1,
    sets: Annotated[int, Form(ge=2, le=people_power.MOST_SETS)] = 20,
    seed: Annotated[int, Form(ge=0, le=2**31 - 1)] = 0,
) -> Response:
    """Start a job that tells how many people are needed."""
    try:
        asked = people_power.PowerRequest.from_form(people, answers, own_share, within, sets, seed)
        people_power.ask(app, caller, study, asked)
    except ConflictError as error:
        return _manage(request, app, caller, study, str(error))
    return _to(study, "/manage")


@router.get("/studies/{slug}/texts")
def texts(study: ChangeOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The form to revise the study's texts."""
    return study_page(
        request,
        app,
        caller,
        study,
        "texts",
        texts=study.texts,
        base=study.plan_hash,
        faults=(),
        differences=(),
    )


@router.post("/studies/{slug}/texts", dependencies=[OwnForm])
async def revise(study: ChangeOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Store revised texts as a new version."""
    form = await request.form()
    given = {
        language: {name: str(form.get(f"{language}/{name}", "")) for name in named}
        for language, named in study.texts.items()
    }
    base = form.get("base")
    said = base if isinstance(base, str) and base else None
    return await run_in_threadpool(_revise, request, app, caller, study, given, said)


def _revise(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    given: dict[str, dict[str, str]],
    base: str | None,
) -> Response:
    try:
        revision.revise_texts(app, study.slug, given, caller.email, base)
    except ChangedMeanwhileError:
        return _revised_meanwhile(request, app, caller, study, given, base or "")
    except StudyFaults as error:
        return study_page(
            request,
            app,
            caller,
            study,
            "texts",
            status_code=422,
            texts=given,
            base=base or study.plan_hash,
            faults=error.faults,
            differences=(),
        )
    return _to(study, "/plan")


def _revised_meanwhile(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    given: dict[str, dict[str, str]],
    base: str,
) -> Response:
    """The submitted texts beside the stored ones, to be saved again over them.

    A text that was not edited since the page was opened is shown as it is stored.
    """
    now = repository.find(app, study.slug)
    opened = revision.texts_of(app, now, base) or {}
    shown: dict[str, dict[str, str]] = {}
    differences = []
    for language, named in now.texts.items():
        shown[language] = {}
        for name, stored in named.items():
            typed = given.get(language, {}).get(name, stored).replace("\r\n", "\n")
            if typed == opened.get(language, {}).get(name):
                typed = stored
            shown[language][name] = typed
            if typed != stored:
                lines = difference(stored, typed)
                differences.append({"of": f"{name} ({language})", "lines": lines})
    return study_page(
        request,
        app,
        caller,
        now,
        "texts",
        status_code=409,
        texts=shown,
        base=now.plan_hash,
        faults=(),
        differences=differences,
        revised=True,
    )


def _manage(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    refused: str | None = None,
) -> Response:
    return study_page(
        request,
        app,
        caller,
        study,
        "manage",
        status_code=200 if refused is None else 409,
        more={
            "plan_hash": study.plan_hash,
            "plan_version": study.plan_version,
            "opened_at": study.opened_at,
            "paused_at": study.paused_at,
        },
        refused=refused,
        may_simulate=simulation_results.SIMULATE in app.job_handlers,
        most_sessions=simulation_results.MOST_SESSIONS,
        job=jobs.newest(app, simulation_results.SIMULATE, study_id=study.id),
        duration=simulation_results.duration(app, study),
        designs=simulation_results.designs(app, study),
        thinking_s=simulation_results.THINKING_S,
        most_people=MOST_PEOPLE,
        power=people_power.newest(app, study),
        power_defaults=people_power.PowerRequest(),
        most_sets=people_power.MOST_SETS,
        reading_s=simulation_results.READING_S,
    )


def _to(study: StudyInfo, place: str) -> Response:
    return RedirectResponse(f"/studies/{study.slug}{place}", status_code=303)
