"""The page of each stage of a session, and the forms of the stages that have one."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import Response

from app.services.runtime.errors import AnswersRefusedError, ResponseRefusedError
from app.services.sessions import advance, questionnaires
from app.services.sessions import responses as pair_answers
from app.services.sessions.answers import Answer
from app.services.sessions.queries import ClientEvent
from app.services.sessions.state_view import State
from app.study.questionnaire import as_meant
from app.web.http.concurrency import limited_write
from app.web.http.security import AppDep, app_context_of, session_cookie
from app.web.http.translations import translatable

from .error_pages import EvaluatorRoute
from .session_pages import do, render, to_stage, token_of

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=EvaluatorRoute)

#: Suffix of the field with the chosen reading of an ambiguous number.
MEANT = ".meant"

TITLES = {
    "welcome": translatable("Welcome"),
    "consent": translatable("Consent"),
    "device_check": translatable("Device check"),
    "instructions": translatable("Instructions"),
    "familiarisation": translatable("Familiarisation"),
    "practice": translatable("Practice"),
    "query": translatable("Which is better?"),
    "waiting": translatable("Being recorded"),
    "questionnaire": translatable("Some questions"),
    "break": translatable("Break"),
    "debrief": translatable("Debrief"),
    "completed": translatable("Thank you"),
    "withdrawn": translatable("You have stopped"),
    "declined": translatable("You have declined"),
    "screened_out": translatable("Thank you"),
}


@router.post("/screen-out")
@limited_write
def screen_out(slug: str, request: Request, app: AppDep) -> Response:
    """End the session at the device check."""
    return do(request, slug, lambda: advance.screen_out(app, token_of(request, slug)))


@router.post("/respond")
@limited_write
def respond(
    slug: str,
    request: Request,
    app: AppDep,
    query_id: Annotated[str, Form(min_length=1, max_length=64)],
    response: Annotated[Literal["left", "right", "skip"], Form()],
    rt_ms: Annotated[float | None, Form(ge=0, le=1e9, allow_inf_nan=False)] = None,
    skip_reason: Annotated[str | None, Form(max_length=60)] = None,
) -> Response:
    """Answer the open query by a form, which the page sends when its scripts have failed."""
    by_form = ClientEvent("sent_by_form", None, rt_ms or 0.0, None)
    answer = Answer(query_id, response, rt_ms, skip_reason, (by_form,))
    # An answer to a pair that has one, or was replaced: the page of the open pair follows.
    with suppress(ResponseRefusedError):
        return do(request, slug, lambda: pair_answers.respond(app, token_of(request, slug), answer))
    return to_stage(slug)


async def form_fields(request: Request) -> dict[str, str]:
    """The fields of a form whose names depend on the study."""
    form = await request.form()
    return {name: value for name, value in form.items() if isinstance(value, str)}


@router.post("/questionnaire")
@limited_write
def questionnaire(
    slug: str,
    request: Request,
    app: AppDep,
    answers: Annotated[dict[str, str], Depends(form_fields)],
) -> Response:
    """Submit the answers; refused ones are shown beside their questions with what was entered."""
    meant = {
        name: as_meant(typed, answers.get(f"{name}{MEANT}"))
        for name, typed in answers.items()
        if not name.endswith(MEANT)
    }
    try:
        return do(request, slug, lambda: questionnaires.answer(app, token_of(request, slug), meant))
    except AnswersRefusedError as error:
        state = advance.current(app, token_of(request, slug))
        faults = {fault.item: fault for fault in error.faults}
        return stage_page(request, slug, state, status=422, given=answers, faults=faults)


def stage_page(
    request: Request, slug: str, state: State, *, status: int = 200, **context: Any
) -> Response:
    """The page of the stage that the session is in."""
    stage = state["stage"]
    shown = state.get(stage) or {}
    name = stage
    if stage == "questionnaire":
        context["kept_as"] = _kept_as(request, slug, state)
    if "waiting" in state:
        name = "waiting"
        context["waited_s"] = _waited_s(request, state["waiting"]["since"])
    return render(
        request,
        slug,
        f"participant/{name}.html",
        TITLES[name],
        state,
        html=shown.get("html", ""),
        version=shown.get("version", ""),
        way_back=shown if "url" in shown else None,
        status=status,
        **context,
    )


def _kept_as(request: Request, slug: str, state: State) -> str:
    """Under what the browser keeps what is typed here: of this session and questionnaire alone."""
    token = request.cookies.get(session_cookie(slug), "")
    place = f"{token}/{state['questionnaire']['page']}/{state['progress']['trial']}"
    return hashlib.sha256(place.encode()).hexdigest()[:16]


def _waited_s(request: Request, since: str | None) -> int:
    """Whole seconds since a time in STATE; 0 if it is unknown."""
    if since is None:
        return 0
    waited = app_context_of(request).now() - datetime.fromisoformat(since)
    return max(0, int(waited.total_seconds()))
