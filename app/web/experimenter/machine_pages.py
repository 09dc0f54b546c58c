"""Machines of a study: who is connected, the queue, the emergency stop, and the operator's desk."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Form, HTTPException, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse, Response

from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.rollouts import (
    acquired,
    desk,
    durations,
    interventions,
    machines,
    pace,
    queue,
    states,
)
from app.services.rollouts.reports import LONGEST_REASON
from app.services.runtime.errors import ServiceError
from app.services.sessions import box_withdrawal
from app.services.studies import access
from app.services.studies.access import Right
from app.services.studies.repository import StudyInfo
from app.web.http.public_address import base_url
from app.web.http.security import AppDep, MaybeExperimenterDep

from .page_context import ChangeOf, OwnForm, SignedIn, signed_in
from .study_frame import study_page
from .upload_forms import sent_files, sent_form, text_in

router = APIRouter(include_in_schema=False)

#: Rollouts that the page lists of those that have ended.
PAST = 50
Reason = Annotated[str, Form(max_length=LONGEST_REASON)]


@router.get("/studies/{slug}/machines")
def machines_page(study: ChangeOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Machines, queue and past rollouts."""
    return _page(request, app, caller, study)


@router.post("/studies/{slug}/machines", dependencies=[OwnForm])
def add(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    name: Annotated[str, Form(max_length=100)] = "",
) -> Response:
    """Add a machine; this response is the only one that shows its token."""
    try:
        token = machines.add(app, study.slug, name.strip(), caller.email)
    except ServiceError as error:
        return _page(request, app, caller, study, refused=str(error))
    return _page(request, app, caller, study, token=token, added=name.strip())


@router.post("/studies/{slug}/machines/revoke", dependencies=[OwnForm])
def revoke(
    study: ChangeOf, app: AppDep, caller: SignedIn, name: Annotated[str, Form(max_length=100)]
) -> Response:
    """Revoke a machine's token."""
    machines.revoke(app, study.slug, name, caller.email)
    return _back(study)


@router.post("/studies/{slug}/machines/stop", dependencies=[OwnForm])
def stop(study: ChangeOf, app: AppDep, caller: SignedIn) -> Response:
    """Emergency stop."""
    machines.stop(app, study.slug, caller.email)
    return _back(study)


@router.post("/studies/{slug}/machines/release", dependencies=[OwnForm])
def release(study: ChangeOf, app: AppDep, caller: SignedIn) -> Response:
    """End the emergency stop."""
    machines.release(app, study.slug, caller.email)
    return _back(study)


@router.post("/studies/{slug}/machines/withdraw", dependencies=[OwnForm])
def withdraw_machine(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    name: Annotated[str, Form(max_length=100)],
    since: Annotated[str, Form(max_length=40)],
    reason: Reason = "",
) -> Response:
    """Withdraw what a machine has recorded since a time in UTC."""
    try:
        moment = datetime.fromisoformat(since)
        moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
        box_withdrawal.withdraw_machine(app, study.slug, name, moment, reason, caller.email)
    except ValueError:
        said = f"expected a time such as 2026-05-01T09:30, got {since!r}"
        return _page(request, app, caller, study, refused=said)
    except ServiceError as error:
        return _page(request, app, caller, study, refused=str(error))
    return _back(study)


@router.post("/studies/{slug}/rollouts/{rollout_id}/cancel", dependencies=[OwnForm])
def cancel(
    study: ChangeOf,
    rollout_id: str,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    reason: Reason = "",
) -> Response:
    """Cancel an outstanding rollout."""
    reason = reason.strip() or "cancelled on the page Machines"
    try:
        interventions.cancel(app, study.slug, rollout_id, reason, caller.email)
    except ServiceError as error:
        return _page(request, app, caller, study, refused=str(error))
    return _back(study)


@router.post("/studies/{slug}/rollouts/{rollout_id}/retry", dependencies=[OwnForm])
def retry(
    study: ChangeOf, rollout_id: str, request: Request, app: AppDep, caller: SignedIn
) -> Response:
    """Ask again for a rollout that failed or was cancelled."""
    try:
        interventions.retry(app, study.slug, rollout_id, caller.email)
    except ServiceError as error:
        return _page(request, app, caller, study, refused=str(error))
    return _back(study)


@router.post("/studies/{slug}/rollouts/{rollout_id}/withdraw", dependencies=[OwnForm])
def withdraw(
    study: ChangeOf,
    rollout_id: str,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    reason: Reason = "",
) -> Response:
    """Withdraw a recording: responses to it leave the model."""
    try:
        box_withdrawal.withdraw(app, study.slug, rollout_id, reason, caller.email)
    except ServiceError as error:
        return _page(request, app, caller, study, refused=str(error))
    return _back(study)


@router.post("/studies/{slug}/machines/results", dependencies=[OwnForm])
def record_results(study: ChangeOf, app: AppDep, caller: SignedIn) -> Response:
    """Ask for recordings of the acquired candidates that have none."""
    acquired.ask(app, study.slug, caller.email)
    return _back(study)


@router.get("/studies/{slug}/desk")
def desk_page(study: ChangeOf, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The operator's desk: the rollout that is being recorded by hand."""
    return _desk(request, app, caller, study)


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
    reason: Reason = "",
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


def _page(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    *,
    refused: str | None = None,
    token: str | None = None,
    added: str | None = None,
) -> Response:
    with app.database.read() as db:
        stopped_at = machines.stopped_since(db, study.id)
        usually = {
            name: durations.usually_s(db, study.id, name)
            for name, environment in study.plan.environments.items()
            if environment.is_machine
        }
        unrecorded = len(acquired.unrecorded(db, study.id))
    listed = [one for one in machines.list_machines(app, study.id) if one.name != machines.DESK]
    waiting = queue.rollouts(app, study.id, statuses=(states.ASKED, states.CLAIMED), limit=200)
    over = (states.RECORDED, states.FAILED, states.UNSAFE, states.CANCELLED, states.WITHDRAWN)
    past = queue.rollouts(app, study.id, statuses=over, limit=PAST)
    working = {one.machine: one for one in waiting if one.status == states.CLAIMED}
    return study_page(
        request,
        app,
        caller,
        study,
        "machines",
        status_code=200 if refused is None else 409,
        refused=refused,
        token=token,
        added=added,
        command=_command(request, study, token) if token else None,
        stopped_at=stopped_at,
        machines=listed,
        working=working,
        inside=machines.INSIDE,
        has_apart=any(
            one.is_machine and not one.is_crane_machine for one in study.plan.environments.values()
        ),
        usually=usually,
        slow=pace.slower_than_viewing(app, study),
        unrecorded=unrecorded,
        counts=queue.counts(app, study.id),
        # The first to be claimed stands first.
        waiting=sorted(
            waiting, key=lambda one: (one.status == states.ASKED, one.priority, one.number)
        ),
        past=past,
        past_limit=PAST,
        describe=lambda line: _values(study, line.parameters),
        seconds=_seconds,
    )


def _desk(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    *,
    refused: str | None = None,
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
        values=[] if taken is None else _named_values(study, taken.parameters),
        asked=queue.counts(app, study.id).get(states.ASKED, 0),
        stopped_at=stopped_at,
        was_recorded="recorded" in request.query_params,
        limit_mb=app.settings.upload_limit_mb,
    )


def _named_values(study: StudyInfo, parameters: Any, digits: int = 6) -> list[tuple[str, str, str]]:
    """Label, value and unit of each parameter, in the plan's order."""
    plan = study.plan
    return [
        (
            plan.text(one.label or one.name, plan.default_language),
            f"{parameters[one.name]:.{digits}g}",
            one.unit or "",
        )
        for one in plan.parameters
        if one.name in parameters
    ]


def _values(study: StudyInfo, parameters: Any) -> str:
    return ", ".join(
        f"{label} {value}{f' {unit}' if unit else ''}"
        for label, value, unit in _named_values(study, parameters, digits=4)
    )


def _seconds(line: queue.RolloutLine) -> float | None:
    if line.claimed_at is None or line.ended_at is None:
        return None
    return (line.ended_at - line.claimed_at).total_seconds()


def _command(request: Request, study: StudyInfo, token: str) -> str:
    url = base_url(request)
    values = " ".join(f"--{one.name} {{{one.name}}}" for one in study.plan.parameters)
    return (
        f"curl -O {url}/machine/pbpo_machine.py\n"
        f"python pbpo_machine.py --url {url} --study {study.slug} --token {token} \\\n"
        f"  -- python run.py {values} --out {{video}}"
    )


def _back(study: StudyInfo) -> Response:
    return RedirectResponse(f"/studies/{study.slug}/machines", status_code=303)


def _to_desk(study: StudyInfo, query: str = "") -> Response:
    return RedirectResponse(f"/studies/{study.slug}/desk{query}", status_code=303)
