"""The JSON API of a session: `/api/v1`."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response

from app.services import access, admission, answers, participation, questionnaires, withdrawal
from app.services.access import Right
from app.services.answers import Answer, FaultReport
from app.services.queries import Happening
from app.services.tokens import receipt_code
from app.services.undoing import undo
from app.study.stages import Device

from .problems import refusals
from .schemas import (
    Answers,
    AskForDeletion,
    GiveConsent,
    GoOn,
    Happened,
    Leave,
    ReportFault,
    Respond,
    SessionState,
    Started,
    StartSession,
    Undo,
    Watched,
)
from .security import MaybeExperimenterDep, SessionToken, StudioDep

State = dict[str, Any]


router = APIRouter(prefix="/api/v1", tags=["session"])


@router.post(
    "/studies/{slug}/sessions",
    status_code=201,
    response_model=Started,
    responses=refusals(403, 404, 409, 422, 429),
)
def start_session(
    slug: str, body: StartSession, studio: StudioDep, caller: MaybeExperimenterDep
) -> Any:
    """Begin a session. The token is shown this once."""
    token, state = admission.start(
        studio,
        slug,
        external_ids=body.external_ids,
        mode=body.mode,
        language=body.language,
        by_experimenter=caller is not None and access.may(studio, caller, slug, Right.CHANGE),
        entry=body.entry,
    )
    return {"token": token, "receipt": receipt_code(token), "session": state}


@router.post("/studies/{slug}/deletions", status_code=204, responses=refusals(404, 422))
def delete_by_receipt(slug: str, body: AskForDeletion, studio: StudioDep) -> None:
    """Delete what the holder of a receipt gave: without an account, at any time."""
    withdrawal.delete_by_receipt(studio, slug, body.receipt)


@router.get("/session", response_model=SessionState, responses=refusals(401))
def get_session(studio: StudioDep, token: SessionToken, response: Response) -> State:
    """Where the session is."""
    response.headers["Cache-Control"] = "no-store"
    return participation.current(studio, token)


@router.post("/session/consent", response_model=SessionState, responses=refusals(401, 409, 422))
def give_consent(body: GiveConsent, studio: StudioDep, token: SessionToken) -> State:
    """Agree to the consent of this version."""
    return participation.consent(studio, token, body.version)


@router.post("/session/continue", response_model=SessionState, responses=refusals(401, 409, 422))
def go_on(studio: StudioDep, token: SessionToken, body: GoOn | None = None) -> State:
    """Leave a page that only has to be left. The device check wants what was measured."""
    measured = body.device if body is not None else None
    device = Device(**measured.model_dump()) if measured is not None else None
    return participation.go_on(studio, token, device)


@router.post("/session/screen-out", response_model=SessionState, responses=refusals(401, 409))
def screen_out(studio: StudioDep, token: SessionToken) -> State:
    """Leave the device check for good: the person has no device that passes it."""
    return participation.screen_out(studio, token)


@router.post(
    "/session/watched", response_model=SessionState, responses=refusals(401, 404, 409, 422)
)
def watched(body: Watched, studio: StudioDep, token: SessionToken) -> State:
    """A video of the familiarisation was watched to its end. The same again changes nothing."""
    return participation.watch(studio, token, body.index)


@router.post(
    "/session/questionnaire", response_model=SessionState, responses=refusals(401, 409, 422)
)
def answer_questionnaire(body: Answers, studio: StudioDep, token: SessionToken) -> State:
    """Answer all items of the open questionnaire. 422 names every answer that cannot be taken."""
    return questionnaires.answer(studio, token, body.answers)


@router.post(
    "/session/responses", response_model=SessionState, responses=refusals(401, 404, 409, 422)
)
def respond(body: Respond, studio: StudioDep, token: SessionToken) -> State:
    """Answer the open query. The same again changes nothing."""
    happenings = _happenings(body.events)
    if body.replays is not None:
        happenings.append(Happening("replays", None, body.rt_ms or 0.0, str(body.replays)))
    answer = Answer(
        query_id=body.query_id,
        response=body.response,
        rt_ms=body.rt_ms,
        skip_reason=body.skip_reason,
        happenings=happenings,
    )
    return answers.respond(studio, token, answer)


@router.post("/session/undo", response_model=SessionState, responses=refusals(401, 404, 409, 422))
def undo_response(body: Undo, studio: StudioDep, token: SessionToken) -> State:
    """Take a response back, while the study lets one."""
    return undo(studio, token, body.query_id)


@router.post("/session/faults", response_model=SessionState, responses=refusals(401, 404, 409, 422))
def report_fault(body: ReportFault, studio: StudioDep, token: SessionToken) -> State:
    """Say that a video of the open query did not play: another one takes its place."""
    report = FaultReport(body.query_id, body.reason, _happenings(body.events))
    return answers.report_fault(studio, token, report)


@router.post("/session/withdraw", response_model=SessionState, responses=refusals(401, 409, 422))
def withdraw(studio: StudioDep, token: SessionToken, body: Leave | None = None) -> State:
    """Stop. Before consent this declines. With `delete` the session is gone afterwards."""
    if body is not None and body.delete:
        return withdrawal.withdraw_and_delete(studio, token)
    return withdrawal.withdraw(studio, token)


def _happenings(events: list[Happened]) -> list[Happening]:
    return [Happening(event.event, event.side, event.time_ms, event.text) for event in events]
