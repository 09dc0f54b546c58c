"""The JSON API of a session: `/api/v1`."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Depends, Request, Response

from app.services.arrival import admission
from app.services.runtime.errors import ForbiddenError
from app.services.runtime.ids import receipt_code
from app.services.sessions import (
    advance,
    questionnaires,
    responses,
    video_faults,
    withdrawal,
)
from app.services.sessions.answers import Answer
from app.services.sessions.queries import ClientEvent
from app.services.sessions.undo import undo
from app.services.sessions.video_faults import FaultReport
from app.services.studies import access
from app.services.studies.access import Right
from app.services.studies.session_modes import LIVE
from app.study.stage_settings import Device
from app.web.http.concurrency import limited_read, limited_write
from app.web.http.json_bodies import ThreadParsedJsonRoute
from app.web.http.problems import refusals
from app.web.http.security import AppDep, MaybeExperimenterDep, credential_of
from app.web.http.session_tokens import SessionToken

from .request_schemas import (
    Answers,
    AskForDeletion,
    GiveConsent,
    GoOn,
    Happened,
    Leave,
    ReportFault,
    Respond,
    StartSession,
    Undo,
    Watched,
)
from .state_schema import SessionState, Started
from .token_schemes import EXPERIMENTER, SESSION, short_id

State = dict[str, Any]

router = APIRouter(prefix="/api/v1", tags=["session"], generate_unique_id_function=short_id)
#: What they answer with: what does not apply is left out.
STATE: Any = {"response_model": SessionState, "response_model_exclude_unset": True}
#: The calls of a session, with its token.
of_session = APIRouter(
    prefix="/session",
    dependencies=[Depends(SESSION)],
    generate_unique_id_function=short_id,
    route_class=ThreadParsedJsonRoute,
)


@router.post(
    "/studies/{slug}/sessions",
    status_code=201,
    response_model=Started,
    response_model_exclude_unset=True,
    dependencies=[Depends(EXPERIMENTER)],
    responses=refusals(404, 409, 410, 429, body=True),
    # A token is needed for sessions that do not count only.
    openapi_extra={"security": [{}]},
)
@limited_write
def start_session(
    slug: str, body: StartSession, request: Request, app: AppDep, caller: MaybeExperimenterDep
) -> Any:
    """Begin a session. The token is shown this once."""
    by_experimenter = caller is not None and access.may(app, caller, slug, Right.CHANGE)
    if body.mode != LIVE and not by_experimenter:
        raise ForbiddenError(
            "expected an experimenter of the study, signed in or with an API token: nobody else may"
            f" begin a session of the mode {body.mode!r} by a call"
        )
    token, state = admission.start(
        app,
        slug,
        external_ids=body.external_ids,
        mode=body.mode,
        language=body.language,
        by_experimenter=by_experimenter,
        entry=body.entry,
        credential=credential_of(request),
    )
    return {"token": token, "receipt": receipt_code(token), "session": state}


@router.post("/studies/{slug}/deletions", status_code=204, responses=refusals(404, 410, body=True))
@limited_write
def delete_by_receipt(slug: str, body: AskForDeletion, app: AppDep) -> None:
    """Delete what the holder of a receipt gave: without an account, at any time."""
    withdrawal.delete_by_receipt(app, slug, body.receipt)


@of_session.get("", responses=refusals(401, 410), **STATE)
@limited_read
def get_session(app: AppDep, token: SessionToken, response: Response) -> State:
    """Where the session is."""
    response.headers["Cache-Control"] = "no-store"
    return advance.current(app, token)


@of_session.post("/consent", responses=refusals(401, 410, 409, body=True), **STATE)
@limited_write
def give_consent(body: GiveConsent, app: AppDep, token: SessionToken) -> State:
    """Agree to the consent of this version."""
    return advance.consent(app, token, body.version)


@of_session.post("/continue", responses=refusals(401, 410, 409, body=True), **STATE)
@limited_write
def go_on(app: AppDep, token: SessionToken, body: GoOn | None = None) -> State:
    """Leave a page that only has to be left. The device check wants what was measured."""
    measured = body.device if body is not None else None
    device = Device(**measured.model_dump()) if measured is not None else None
    return advance.continue_session(app, token, device)


@of_session.post("/screen-out", responses=refusals(401, 410, 403, 409), **STATE)
@limited_write
def screen_out(app: AppDep, token: SessionToken) -> State:
    """Leave the device check for good: the person has no device that passes it."""
    return advance.screen_out(app, token)


@of_session.post("/watched", responses=refusals(401, 410, 404, 409, body=True), **STATE)
@limited_write
def watched(body: Watched, app: AppDep, token: SessionToken) -> State:
    """A video of the familiarisation was watched to its end. The same again changes nothing."""
    return advance.watch(app, token, body.index)


@of_session.post("/questionnaire", responses=refusals(401, 410, 409, body=True), **STATE)
@limited_write
def answer_questionnaire(body: Answers, app: AppDep, token: SessionToken) -> State:
    """Answer all items of the open questionnaire. 422 names every answer that cannot be taken."""
    return questionnaires.answer(app, token, body.answers)


@of_session.post("/responses", responses=refusals(401, 410, 404, 409, body=True), **STATE)
@limited_write
def respond(body: Respond, app: AppDep, token: SessionToken) -> State:
    """Answer the open query. The same again changes nothing."""
    client_events = _happenings(body.events)
    if body.replays is not None:
        client_events.append(ClientEvent("replays", None, body.rt_ms or 0.0, str(body.replays)))
    answer = Answer(
        query_id=body.query_id,
        response=body.response,
        rt_ms=body.rt_ms,
        skip_reason=body.skip_reason,
        client_events=client_events,
        left_out=body.events_left_out,
    )
    return responses.respond(app, token, answer)


@of_session.post("/undo", responses=refusals(401, 410, 404, 409, body=True), **STATE)
@limited_write
def undo_response(body: Undo, app: AppDep, token: SessionToken) -> State:
    """Take a response back, while the study lets one."""
    return undo(app, token, body.query_id)


@of_session.post("/faults", responses=refusals(401, 410, 404, 409, body=True), **STATE)
@limited_write
def report_fault(body: ReportFault, app: AppDep, token: SessionToken) -> State:
    """Say that a video of the open query did not play: another one takes its place."""
    report = FaultReport(body.query_id, body.reason, _happenings(body.events), body.events_left_out)
    return video_faults.report_fault(app, token, report)


@of_session.post("/withdraw", responses=refusals(401, 410, 409, body=True), **STATE)
@limited_write
def withdraw(app: AppDep, token: SessionToken, body: Leave | None = None) -> State:
    """Stop. Before consent this declines. With `delete` the session is gone afterwards."""
    if body is not None and body.delete:
        return withdrawal.withdraw_and_delete(app, token)
    return withdrawal.withdraw(app, token)


router.include_router(of_session)


def _happenings(events: list[Happened]) -> list[ClientEvent]:
    return [ClientEvent(event.event, event.side, event.time_ms, event.text) for event in events]
