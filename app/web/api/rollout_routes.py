"""The calls of machines, and the list of rollouts for experimenters.

A call for work waits without a thread and without a connection (`work_polling`). An upload is
written as it comes, and is finished in a thread of its own.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Collection, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Annotated, Any, Final

from anyio import CapacityLimiter, to_thread
from anyio.lowlevel import RunVar
from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import JSONResponse
from sqlalchemy.exc import SQLAlchemyError
from starlette.requests import ClientDisconnect

from app.services.context import AppContext
from app.services.rollouts import acceptance, claims, machines, queue, reports, uploads
from app.services.rollouts.acceptance import Verdict
from app.services.rollouts.machines import MachineCaller
from app.services.rollouts.uploads import Upload
from app.services.runtime.errors import (
    ConflictError,
    LeaseLostError,
    NotFoundError,
    RecordingTooLargeError,
)
from app.services.studies import access
from app.services.studies.access import Right
from app.web.http.json_bodies import ThreadParsedJsonRoute
from app.web.http.problems import refusals
from app.web.http.security import AppDep, ExperimenterDep

from .machine_calls import MachineDep, in_machine_thread
from .recording_headers import digests_of, part_of
from .rollout_schemas import (
    Attempt,
    Beat,
    ClaimedRollout,
    ClaimWork,
    Failed,
    LeaseRenewed,
    Measurements,
    Queue,
    RolloutStatus,
    Unsafe,
    UploadContinues,
    UploadTaken,
)
from .token_schemes import EXPERIMENTER, MACHINE, short_id
from .work_polling import WorkPolling

router = APIRouter(
    prefix="/api/v1/studies/{slug}/rollouts",
    tags=["rollouts"],
    generate_unique_id_function=short_id,
    route_class=ThreadParsedJsonRoute,
)
_OF_MACHINE: Final = [Depends(MACHINE)]

#: Recordings that one process decodes at the same time: each has a process of its own.
_DECODED_AT_ONCE: Final = 2
#: Bytes that are gathered before they are written to the disk.
_PIECE: Final = 1 << 20

_decoding: RunVar[CapacityLimiter] = RunVar("decoding of recordings")


@router.post(
    "/claim",
    response_model=ClaimedRollout,
    dependencies=_OF_MACHINE,
    responses={
        204: {"description": "No work, or the machines are stopped: ask again."},
        **refusals(401, 409, 429, body=True),
    },
)
async def claim_rollout(
    request: Request, app: AppDep, caller: MachineDep, body: ClaimWork | None = None
) -> Any:
    """Claim the next rollout, and wait for one if there is none. The lease begins now."""
    asked = body or ClaimWork.model_validate({})
    if asked.machine is not None and asked.machine != caller.name:
        raise ConflictError(
            f"expected the machine {caller.name!r}, whose token this is, got {asked.machine!r}"
        )
    await in_machine_thread(machines.touch, app, caller)
    claimed = await _wait_for_work(request, app, caller, asked)
    if claimed is None:
        return Response(status_code=204)
    return {
        "id": claimed.public_id,
        "environment": claimed.environment,
        "parameters": claimed.parameters,
        "seed": claimed.seed,
        "run_index": claimed.run_index,
        "attempt": claimed.attempt,
        "reason": claimed.reason,
        "timeout_s": claimed.timeout_s,
        "lease": _lease(app, claimed.lease_until),
    }


@router.post(
    "/{rollout_id}/heartbeat",
    response_model=LeaseRenewed,
    dependencies=_OF_MACHINE,
    responses=refusals(401, 404, 409, 429, body=True),
)
async def heartbeat(
    rollout_id: str, app: AppDep, caller: MachineDep, body: Beat | None = None
) -> Any:
    """Renew the lease. 409: it was given to another machine, or the rollout has ended."""
    beat = body or Beat.model_validate({})
    await in_machine_thread(machines.touch, app, caller)
    lease = await in_machine_thread(
        claims.heartbeat, app, caller, rollout_id, attempt=beat.attempt, progress=beat.progress
    )
    return {"lease": _lease(app, lease.until), "stopped": lease.is_stopped}


@router.put(
    "/{rollout_id}/recording",
    status_code=201,
    response_model=UploadTaken,
    dependencies=_OF_MACHINE,
    responses={
        200: {
            "model": UploadTaken,
            "description": "The same bytes were recorded before, or the rollout had ended"
            " otherwise and `kept` is false.",
        },
        202: {
            "model": UploadContinues,
            "description": "A part has arrived: continue with `Content-Range`.",
        },
        **refusals(401, 404, 409, 429, body=True),
    },
    openapi_extra={
        "requestBody": {
            "required": True,
            "description": "The video's bytes, or with `Content-Range: bytes 0-999/5000` a part of"
            " them; `bytes */5000` and no body asks how many have arrived. `Repr-Digest` or"
            " `Digest`, of the whole video, is checked.",
            "content": {
                "application/octet-stream": {"schema": {"type": "string", "format": "binary"}}
            },
        }
    },
)
async def put_recording(
    rollout_id: str,
    request: Request,
    app: AppDep,
    caller: MachineDep,
    attempt: Annotated[Attempt | None, Query()] = None,
) -> Response:
    """Upload the recording. It is decoded to its end, and transcoded if browsers cannot play it."""
    try:
        part, digests = part_of(request.headers), digests_of(request.headers)
        upload = await in_machine_thread(uploads.begin, app, caller, rollout_id, attempt, part)
        with upload:
            async with _renewing(app, caller, rollout_id, attempt):
                await _receive(request, upload)
                if not upload.is_whole:
                    content = {"received": upload.received, "total": upload.total}
                    return JSONResponse(content, 202)
                found = await to_thread.run_sync(
                    acceptance.finish,
                    *(app, caller, rollout_id, attempt, upload, digests),
                    limiter=_decoders(),
                )
    except RecordingTooLargeError as error:
        # Sending it again would not help: the attempt has failed.
        await in_machine_thread(acceptance.fail, app, caller, rollout_id, attempt, str(error))
        raise
    except ClientDisconnect:
        # What has arrived is kept; nobody reads this answer.
        return Response(status_code=400)
    kept = found.verdict is not Verdict.NOT_KEPT
    status = 201 if found.verdict is Verdict.RECORDED else 200
    return JSONResponse({"status": found.status, "kept": kept, "detail": found.said}, status)


@router.post(
    "/{rollout_id}/measurements",
    response_model=RolloutStatus,
    dependencies=_OF_MACHINE,
    responses=refusals(401, 404, 409, 429, body=True),
)
async def put_measurements(
    rollout_id: str, body: Measurements, app: AppDep, caller: MachineDep
) -> Any:
    """Store a score and series of the run, before its recording is uploaded."""
    await in_machine_thread(
        reports.measured,
        *(app, caller, rollout_id),
        score=body.score,
        series=body.series,
        attempt=body.attempt,
    )
    return {"status": "claimed"}


@router.post(
    "/{rollout_id}/failed",
    response_model=RolloutStatus,
    dependencies=_OF_MACHINE,
    responses=refusals(401, 404, 409, 429, body=True),
)
async def report_failed(rollout_id: str, body: Failed, app: AppDep, caller: MachineDep) -> Any:
    """The machine failed. The rollout is tried again while attempts remain."""
    status = await in_machine_thread(
        reports.failed,
        *(app, caller, rollout_id, body.reason),
        attempt=body.attempt,
        give_back=body.give_back,
    )
    return {"status": status}


@router.post(
    "/{rollout_id}/unsafe",
    response_model=RolloutStatus,
    dependencies=_OF_MACHINE,
    responses=refusals(401, 404, 409, 429, body=True),
)
async def report_unsafe(rollout_id: str, body: Unsafe, app: AppDep, caller: MachineDep) -> Any:
    """These parameters must not be run. They are never proposed again."""
    await in_machine_thread(reports.unsafe, app, caller, rollout_id, body.reason)
    return {"status": "unsafe"}


@router.get(
    "",
    response_model=Queue,
    dependencies=[Depends(EXPERIMENTER)],
    responses=refusals(401, 403, 404),
)
def list_rollouts(
    slug: str,
    app: AppDep,
    caller: ExperimenterDep,
    status: Annotated[list[str] | None, Query(description="Only these states.")] = None,
    before: Annotated[int | None, Query(ge=0, le=2**53)] = None,
    limit: Annotated[int, Query(ge=1, le=500)] = 100,
) -> Any:
    """The machines of a study, its queue and past rollouts, for experimenters."""
    study = access.study_for(app, caller, slug, Right.DATA)
    lines = queue.rollouts(app, study.id, statuses=status or (), before=before, limit=limit)
    with app.database.read() as db:
        stopped_at = machines.stopped_since(db, study.id)
    return {
        "stopped_at": stopped_at,
        "machines": [
            {
                "name": one.name,
                "connected": one.is_connected,
                "last_seen_at": one.last_seen_at,
                "revoked_at": one.revoked_at,
            }
            for one in machines.list_machines(app, study.id)
        ],
        "rollouts": [
            {
                **vars(line),
                "id": line.public_id,
                "candidate": line.candidate_index,
            }
            for line in lines
        ],
        "before": lines[-1].number if len(lines) == limit else None,
    }


async def _wait_for_work(
    request: Request, app: AppContext, caller: MachineCaller, asked: ClaimWork
) -> claims.Claimed | None:
    """The claimed rollout; None once the time is over, the caller is gone, or the server stops."""
    polling: WorkPolling = request.app.state.work_polling
    loop = asyncio.get_running_loop()
    ends = loop.time() + asked.wait_s

    def stopping() -> bool:
        told: bool = request.app.state.stopping()
        return told

    def find(studies: Collection[int]) -> Mapping[tuple[int, str], int]:
        with app.database.read() as db:
            return claims.claimable(db, studies, app.now())

    with polling.waiting(caller.study_id, asked.environments, find, stopping) as waiter:
        while True:
            claimed = await in_machine_thread(claims.claim, app, caller, asked.environments)
            left_s = ends - loop.time()
            if claimed is not None or left_s <= 0 or stopping():
                return claimed
            await waiter.wait(left_s)
            if await request.is_disconnected():
                # Whoever is gone must not take work.
                return None
            # Revoked while it waited: the token opens nothing any more.
            await in_machine_thread(machines.require_in_force, app, caller)


async def _receive(request: Request, upload: Upload) -> None:
    """Write the body as it comes. Raises ClientDisconnect, with what has come written."""
    waiting = bytearray()
    try:
        async for chunk in request.stream():
            waiting += chunk
            if len(waiting) >= _PIECE:
                data, waiting = bytes(waiting), bytearray()
                await in_machine_thread(upload.write, data)
    finally:
        if waiting:
            await in_machine_thread(upload.write, bytes(waiting))
    upload.end_of_unknown_length()


@asynccontextmanager
async def _renewing(
    app: AppContext, caller: MachineCaller, rollout_id: str, attempt: int | None
) -> AsyncIterator[None]:
    """Renew the lease during the block: bytes that come are a sign of life, and so is decoding."""

    async def renew() -> None:
        while True:
            await asyncio.sleep(claims.HEARTBEAT_S)
            # A lost lease does not end an upload: it may still be kept.
            with suppress(LeaseLostError, NotFoundError, SQLAlchemyError):
                await in_machine_thread(claims.heartbeat, app, caller, rollout_id, attempt=attempt)

    task = asyncio.create_task(renew())
    try:
        yield
    finally:
        task.cancel()


def _decoders() -> CapacityLimiter:
    try:
        return _decoding.get()
    except LookupError:
        limiter = CapacityLimiter(_DECODED_AT_ONCE)
        _decoding.set(limiter)
        return limiter


def _lease(app: AppContext, until: Any) -> dict[str, Any]:
    seconds = (until - app.now()).total_seconds()
    return {"until": until, "seconds": max(0.0, seconds), "heartbeat_s": claims.HEARTBEAT_S}
