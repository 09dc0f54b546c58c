"""Claims of rollouts by machines: leases, heartbeats, and leases that have ended.

A claim gives a machine a lease. If nothing is heard of the machine until the lease ends, the
attempt has failed, and the rollout is asked again. Ended leases are found by whoever looks next, so
nothing depends on a process that stays alive.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final

from sqlalchemy import and_, func, or_, select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, LeaseLostError
from app.services.studies import repository
from app.storage.models.rollouts import Machine, Rollout
from app.storage.models.studies import PlanVersion, Study
from app.study.plan import Plan

from . import outcomes, states
from .machines import MachineCaller

#: Interval at which machines are asked to send heartbeats, in seconds.
HEARTBEAT_S: Final = 10
#: Lease after a heartbeat, unless `timeout_s` is shorter: a machine that sends heartbeats is missed
#: sooner than one that sends none.
LEASE_AFTER_HEARTBEAT: Final = timedelta(seconds=45)


@dataclass(frozen=True)
class Claimed:
    """What a machine is told of a rollout: the parameters, a seed, and how long it may be silent.

    attempt: the number of this claim of the rollout, from 1; it names the lease. reason: why the
    rollout is asked, `query`, `ahead` or `acquired`. run_index: the number of the run of these
    parameters, from 0.
    """

    public_id: str
    environment: str
    parameters: Mapping[str, Any]
    seed: int
    run_index: int
    attempt: int
    reason: str
    lease_until: datetime
    timeout_s: float


@dataclass(frozen=True)
class Lease:
    """The lease after a heartbeat. is_stopped: whether the emergency stop is in force."""

    until: datetime
    is_stopped: bool


def claim(
    app: AppContext,
    caller: MachineCaller,
    environments: Sequence[str] | None = None,
    *,
    inside: bool = False,
    lease: timedelta | None = None,
) -> Claimed | None:
    """Claim the rollout of the smallest priority, the oldest of those; None if there is no work.

    environments: only rollouts of these; None for all. inside: whether the caller is the machine
    inside the server, which gets the rollouts of `machine crane` and no others. lease: how long it
    lasts; None for the `timeout_s` of the environment. Raises ConflictError for an unknown
    environment.
    """
    with app.database.read() as db:
        _require_known(_plan(db, caller.study_id), environments or ())
        if not claimable(db, [caller.study_id], app.now()):
            return None
    with app.database.write() as db:
        now = app.now()
        plan = _plan(db, caller.study_id)
        expire_leases(db, caller.study_id, now)
        wanted = [
            name
            for name, environment in plan.environments.items()
            if environment.is_machine
            and environment.is_crane_machine == inside
            and (environments is None or name in environments)
        ]
        machine = db.get(Machine, caller.machine_id)
        is_revoked = machine is None or machine.revoked_at is not None
        if not wanted or is_revoked or _is_stopped(db, caller.study_id, locks=True):
            return None
        rollout = db.scalar(
            select(Rollout)
            .where(
                Rollout.study_id == caller.study_id,
                Rollout.status == states.ASKED,
                Rollout.environment.in_(wanted),
            )
            .order_by(Rollout.priority, Rollout.asked_at, Rollout.id)
            .limit(1)
            .with_for_update(skip_locked=True)
            .execution_options(populate_existing=True)
        )
        if rollout is None:
            return None
        timeout_s = plan.environments[rollout.environment].rollout.timeout_s
        rollout.status = states.CLAIMED
        rollout.attempt += 1
        rollout.machine_id = caller.machine_id
        rollout.claimed_at = now
        rollout.lease_until = now + (lease or timedelta(seconds=timeout_s))
        rollout.progress = None
        rollout.score = rollout.series = None
        return Claimed(
            public_id=rollout.public_id,
            environment=rollout.environment,
            parameters=dict(rollout.candidate.parameters),
            seed=rollout.seed,
            run_index=rollout.run_index,
            attempt=rollout.attempt,
            reason=rollout.reason,
            lease_until=rollout.lease_until,
            timeout_s=timeout_s,
        )


def heartbeat(
    app: AppContext,
    caller: MachineCaller,
    public_id: str,
    *,
    attempt: int | None = None,
    progress: float | None = None,
    lease: timedelta = LEASE_AFTER_HEARTBEAT,
) -> Lease:
    """Renew the lease of a claimed rollout. A lease that has ended is renewed if nobody noticed.

    attempt: of the claim; None for the machine's present one. progress: from 0 to 1. lease: how
    long it lasts now, at most the `timeout_s` of the environment. Raises NotFoundError, or
    LeaseLostError if the machine does not hold the rollout any more.
    """
    with app.database.write() as db:
        now = app.now()
        rollout = held(db, caller, public_id, attempt)
        timeout_s = timeout_of(_plan(db, caller.study_id), rollout)
        rollout.lease_until = now + min(lease, timedelta(seconds=timeout_s))
        if progress is not None:
            rollout.progress = progress
        return Lease(rollout.lease_until, _is_stopped(db, caller.study_id))


def held(db: Session, caller: MachineCaller, public_id: str, attempt: int | None) -> Rollout:
    """The rollout, locked, if the machine has it. Raises NotFoundError or LeaseLostError."""
    rollout = outcomes.locked(db, caller.study_id, public_id)
    if not holds(rollout, caller, attempt):
        raise LeaseLostError(who_has(rollout))
    return rollout


def holds(rollout: Rollout, caller: MachineCaller, attempt: int | None) -> bool:
    """Whether the machine has claimed the rollout, and not lost it."""
    return (
        rollout.status == states.CLAIMED
        and rollout.machine_id == caller.machine_id
        and attempt in (None, rollout.attempt)
    )


def expire_leases(db: Session, study_id: int, now: datetime) -> int:
    """End the claims of a study whose lease has ended; return their number.

    Each counts as a failed attempt: the rollout is asked again, or has failed.
    """
    plan = _plan(db, study_id)
    ended = db.scalars(
        select(Rollout)
        .where(
            Rollout.study_id == study_id,
            Rollout.status == states.CLAIMED,
            Rollout.lease_until <= now,
        )
        .order_by(Rollout.id)
        .with_for_update(skip_locked=True)
        .execution_options(populate_existing=True)
    ).all()
    for rollout in ended:
        machine = None if rollout.machine_id is None else db.get(Machine, rollout.machine_id)
        outcomes.fail(
            db,
            rollout,
            machine=machine,
            reason=outcomes.LEASE_ENDED,
            attempts=attempts_of(plan, rollout),
            now=now,
        )
    db.flush()
    return len(ended)


def claimable(
    db: Session, study_ids: Collection[int], now: datetime
) -> Mapping[tuple[int, str], int]:
    """The numbers of rollouts that a machine could claim, by study and environment.

    Rollouts whose lease has ended count; those of studies whose machines are stopped do not.
    """
    rows = db.execute(
        select(Rollout.study_id, Rollout.environment, func.count(Rollout.id))
        .join(Study, Rollout.study_id == Study.id)
        .where(
            Rollout.study_id.in_(study_ids),
            Study.machines_stopped_at.is_(None),
            or_(
                Rollout.status == states.ASKED,
                and_(Rollout.status == states.CLAIMED, Rollout.lease_until <= now),
            ),
        )
        .group_by(Rollout.study_id, Rollout.environment)
    )
    return {(study_id, environment): number for study_id, environment, number in rows}


def attempts_of(plan: Plan, rollout: Rollout) -> int:
    """How many failed attempts end this rollout."""
    return plan.environments[rollout.environment].rollout.attempts


def timeout_of(plan: Plan, rollout: Rollout) -> float:
    """How long a machine may be silent about this rollout, in seconds."""
    return plan.environments[rollout.environment].rollout.timeout_s


def plan_of(db: Session, study_id: int) -> Plan:
    """The newest plan of a study."""
    return _plan(db, study_id)


def _plan(db: Session, study_id: int) -> Plan:
    version = db.scalars(
        select(PlanVersion)
        .where(PlanVersion.study_id == study_id)
        .order_by(PlanVersion.version.desc())
        .limit(1)
    ).one()
    return repository.stored_plan(version)


def _require_known(plan: Plan, environments: Sequence[str]) -> None:
    known = [name for name, environment in plan.environments.items() if environment.is_machine]
    unknown = [name for name in environments if name not in known]
    if unknown:
        raise ConflictError(
            f"expected environments of machines, {', '.join(known) or 'of which there are none'},"
            f" got {unknown[0]!r}"
        )


def _is_stopped(db: Session, study_id: int, *, locks: bool = False) -> bool:
    """Whether the emergency stop is in force. locks: it does not begin during the transaction."""
    statement = select(Study.machines_stopped_at).where(Study.id == study_id)
    if locks:
        statement = statement.with_for_update(read=True)
    return db.scalar(statement) is not None


def who_has(rollout: Rollout) -> str:
    """Why a machine cannot report on this rollout, as a sentence that says where it is."""
    said = {
        states.ASKED: "its lease has ended, and it waits for any machine",
        states.CLAIMED: "another machine or attempt has it",
    }
    return (
        "expected a rollout that this machine has claimed, and"
        f" {said.get(rollout.status, f'it is {rollout.status}')}"
    )
