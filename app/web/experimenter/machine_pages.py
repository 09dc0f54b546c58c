"""Machines of a study: who is connected, the queue, what has become of rollouts, emergency stop."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.rollouts import (
    acquired,
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
from app.services.studies.repository import StudyInfo
from app.web.http.public_address import base_url
from app.web.http.security import AppDep

from . import parameter_values
from .page_context import ChangeOf, OwnForm, SignedIn
from .study_frame import study_page

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
        describe=lambda line: parameter_values.in_words(study, line.parameters),
        seconds=_seconds,
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
