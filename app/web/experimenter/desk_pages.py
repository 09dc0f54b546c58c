"""The operator's desk of a study: rollouts that are recorded by hand, also on a phone."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, HTTPException, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse, Response

from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.rollouts import desk, machines, queue, states
from app.services.rollouts.reports import LONGEST_REASON
from app.services.runtime.errors import ServiceError
from app.services.studies import access
from app.services.studies.access import Right
from app.services.studies.repository import StudyInfo
from app.web.http.security import AppDep, MaybeExperimenterDep

from . import parameter_values
from .page_context import ChangeOf, OwnForm, SignedIn, signed_in
from .study_frame import study_page
from .upload_forms import sent_files, sent_form, text_in

router = APIRouter(include_in_schema=False)


@router.get("/studies/{slug}/desk")
def desk_page(
    study: ChangeOf, request: Request, app: AppDep, caller: SignedIn, recorded: str | None = None
) -> Response:
    """The operator's desk: the rollout that is being recorded by hand.

    recorded: given after a video was taken.
    """
    return _desk(request, app, caller, study, was_recorded=recorded is not None)


@router.post("/studies/{slug}/desk/take", dependencies=[OwnForm])
def take(study: ChangeOf, app: AppDep) -> Response:
    """Take the next rollout."""
    desk.take(app, study)
    return _to_desk(study)


@router.post("/studies/{slug}/desk/{rollout_id}/recording")
async def hand_in(
    slug: str, rollout_id: str, request: Request, app: AppDep, caller: MaybeExperimenterDep
) -> Response:
    """Take the video. Rights and form token are checked before a byte of it is stored."""
    somebody = signed_in(request, caller)
    study = await run_in_threadpool(access.study_for, app, somebody, slug, Right.CHANGE)
    async with sent_form(request, app, somebody) as form:
        files, attempt = sent_files(form, "video"), text_in(form, "attempt")
        if not attempt.isdecimal() or len(attempt) > 6:
            raise HTTPException(400, "Expected the number of the attempt")
        try:
            if not files:
                raise HTTPException(400, "Expected a video, and none was chosen")
            file = files[0].content
            size = file.seek(0, 2)
            file.seek(0)
            await run_in_threadpool(desk.hand_in, app, study, rollout_id, int(attempt), file, size)
        except ServiceError as error:
            return await run_in_threadpool(_desk, request, app, somebody, study, refused=str(error))
    return _to_desk(study, "?recorded=yes")


@router.post("/studies/{slug}/desk/{rollout_id}/report", dependencies=[OwnForm])
def report(
    study: ChangeOf,
    rollout_id: str,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    what: Annotated[str, Form(pattern="^(failed|unsafe|back)$")],
    reason: Annotated[str, Form(max_length=LONGEST_REASON)] = "",
) -> Response:
    """The run failed, must never be run, or is left to others."""
    try:
        if what == "unsafe":
            desk.unsafe(app, study, rollout_id, reason.strip() or "said to be unsafe at the desk")
        else:
            said = reason.strip() or "no reason was given at the desk"
            desk.failed(app, study, rollout_id, said, give_back=what == "back")
    except ServiceError as error:
        return _desk(request, app, caller, study, refused=str(error))
    return _to_desk(study)


def _desk(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    *,
    refused: str | None = None,
    was_recorded: bool = False,
) -> Response:
    taken = desk.held(app, study)
    with app.database.read() as db:
        stopped_at = machines.stopped_since(db, study.id)
    return study_page(
        request,
        app,
        caller,
        study,
        "desk",
        status_code=200 if refused is None else 409,
        refused=refused,
        taken=taken,
        values=[] if taken is None else parameter_values.named(study, taken.parameters),
        asked=queue.counts(app, study.id).get(states.ASKED, 0),
        stopped_at=stopped_at,
        was_recorded=was_recorded,
        limit_mb=app.settings.upload_limit_mb,
    )


def _to_desk(study: StudyInfo, query: str = "") -> Response:
    return RedirectResponse(f"/studies/{study.slug}/desk{query}", status_code=303)
