"""Machines of a study: names and tokens, and the emergency stop.

A machine's token opens the calls of machines of its study and nothing else. It is shown once; only
its hash is stored.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Final

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from app.services.accounts import audit_log
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, NotFoundError, SignInRequiredError
from app.services.runtime.ids import is_secret, new_secret, secret_hash
from app.services.studies import repository
from app.storage.models.rollouts import Machine, Rollout
from app.storage.models.studies import Study

from . import outcomes, states

#: Form of a machine's name: it stands in commands, tables and file names.
NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,59}")
#: Names of rows without a token: the machine inside the server, and the operator's desk.
INSIDE: Final = "crane"
DESK: Final = "desk"
_RESERVED: Final = (INSIDE, DESK)

#: A machine counts as connected for so long after its last call. It exceeds the longest wait of a
#: call for work, during which a machine says nothing.
CONNECTED_FOR: Final = timedelta(seconds=90)
#: Shortest interval between two writes of when a machine was seen.
_SEEN_EVERY: Final = timedelta(seconds=10)


@dataclass(frozen=True)
class MachineCaller:
    """An authenticated machine."""

    machine_id: int
    name: str
    study_id: int
    slug: str


@dataclass(frozen=True)
class MachineInfo:
    """A machine as experimenters see it. has_token: whether it calls from outside the server."""

    id: int
    name: str
    has_token: bool
    created_at: datetime
    last_seen_at: datetime | None
    revoked_at: datetime | None
    is_connected: bool


def add(app: AppContext, slug: str, name: str, actor: str = audit_log.COMMAND_LINE) -> str:
    """Create a machine of a study and return its token. A revoked name gets a new token.

    Raises NotFoundError for an unknown study, and ConflictError if the name has another form, is
    reserved or in use, or if no environment of the study takes recordings from machines outside.
    """
    if NAME.fullmatch(name) is None:
        raise ConflictError(
            "expected a name of 1 to 60 letters, digits, dots, hyphens and underscores that begins"
            f" with a letter or a digit, got {name[:80]!r}"
        )
    if name in _RESERVED:
        raise ConflictError(f"expected another name: {name!r} is reserved")
    token = new_secret()
    with app.database.write() as db:
        study = repository.lock_study(db, slug)
        _require_machine_environment(repository.read(db, slug))
        machine = db.scalar(
            select(Machine).where(Machine.study_id == study.id, Machine.name == name)
        )
        if machine is None:
            machine = Machine(study_id=study.id, name=name, created_at=app.now())
            db.add(machine)
        elif machine.revoked_at is None:
            raise ConflictError(
                f"expected a new name, and {slug!r} has a machine {name!r}: revoke it first, or"
                " give the new one another name"
            )
        machine.token_hash = secret_hash(token)
        machine.revoked_at = None
        audit_log.note(db, app.now(), actor, "machine added", slug, machine=name)
    return token


def revoke(app: AppContext, slug: str, name: str, actor: str = audit_log.COMMAND_LINE) -> None:
    """Revoke a machine's token at once, and ask again for the rollouts that it has claimed.

    Revoking it again changes nothing. Raises NotFoundError.
    """
    with app.database.write() as db:
        study = repository.lock_study(db, slug)
        machine = db.scalar(
            select(Machine).where(
                Machine.study_id == study.id, Machine.name == name, Machine.name.not_in(_RESERVED)
            )
        )
        if machine is None:
            raise NotFoundError(f"there is no machine {name!r} in {slug!r}")
        if machine.revoked_at is not None:
            return
        machine.revoked_at = app.now()
        machine.token_hash = None
        claimed = db.scalars(
            select(Rollout)
            .where(Rollout.machine_id == machine.id, Rollout.status == states.CLAIMED)
            .with_for_update()
        )
        for rollout in claimed:
            outcomes.ask_again(db, rollout)
        audit_log.note(db, app.now(), actor, "machine revoked", slug, machine=name)


def authenticate(app: AppContext, slug: str, token: str | None) -> MachineCaller:
    """The machine of this study with this token. Raises SignInRequiredError.

    The error is the same for a study that does not exist, so that a token tells nothing of others.
    """
    if token is not None and is_secret(token):
        with app.database.read() as db:
            row = db.execute(
                select(Machine.id, Machine.name, Study.id)
                .join(Study, Machine.study_id == Study.id)
                .where(
                    Machine.token_hash == secret_hash(token),
                    Machine.revoked_at.is_(None),
                    Study.slug == slug,
                )
            ).one_or_none()
        if row is not None:
            return MachineCaller(row[0], row[1], row[2], slug)
    raise SignInRequiredError("expected the token of a machine of this study, in force")


def require_in_force(app: AppContext, caller: MachineCaller) -> None:
    """Raise SignInRequiredError if the machine was revoked since it called."""
    with app.database.read() as db:
        row = db.get(Machine, caller.machine_id)
        if row is None or row.revoked_at is not None:
            raise SignInRequiredError("expected a token in force, and this machine was revoked")


def stop(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> None:
    """Emergency stop: no machine of the study gets work, and running ones are told to stop.

    Stopping again changes nothing. Raises NotFoundError.
    """
    with app.database.write() as db:
        study = repository.lock_study(db, slug)
        if study.machines_stopped_at is None:
            study.machines_stopped_at = app.now()
            audit_log.note(db, app.now(), actor, "machines stopped", slug)


def release(app: AppContext, slug: str, actor: str = audit_log.COMMAND_LINE) -> None:
    """End the emergency stop. Releasing again changes nothing. Raises NotFoundError."""
    with app.database.write() as db:
        study = repository.lock_study(db, slug)
        if study.machines_stopped_at is not None:
            study.machines_stopped_at = None
            audit_log.note(db, app.now(), actor, "machines released", slug)


def stopped_since(db: Session, study_id: int) -> datetime | None:
    """Since when the machines of a study are stopped; None if they are not."""
    return db.scalar(select(Study.machines_stopped_at).where(Study.id == study_id))


def list_machines(app: AppContext, study_id: int) -> list[MachineInfo]:
    """The machines of a study by name, revoked ones included."""
    now = app.now()
    with app.database.read() as db:
        rows = db.scalars(
            select(Machine).where(Machine.study_id == study_id).order_by(Machine.name)
        )
        return [
            MachineInfo(
                id=row.id,
                name=row.name,
                has_token=row.token_hash is not None,
                created_at=row.created_at,
                last_seen_at=row.last_seen_at,
                revoked_at=row.revoked_at,
                is_connected=is_connected(row, now),
            )
            for row in rows
        ]


def is_connected(machine: Machine, now: datetime) -> bool:
    """Whether the machine has called lately and may call."""
    seen = machine.last_seen_at
    return machine.revoked_at is None and seen is not None and now - seen < CONNECTED_FOR


def touch(app: AppContext, caller: MachineCaller) -> None:
    """Store that the machine has called just now, unless that was stored seconds ago."""
    now = app.now()
    with app.database.read() as db:
        seen = db.scalar(select(Machine.last_seen_at).where(Machine.id == caller.machine_id))
    if seen is None or now - seen >= _SEEN_EVERY or seen > now:
        with app.database.write() as db:
            db.execute(
                update(Machine).where(Machine.id == caller.machine_id).values(last_seen_at=now)
            )


def without_token(db: Session, study_id: int, name: str, now: datetime) -> Machine:
    """The row of the machine inside the server (INSIDE) or of the operator's desk (DESK).

    It is created when it is first needed. The caller has locked the study, or is alone.
    """
    machine = db.scalar(select(Machine).where(Machine.study_id == study_id, Machine.name == name))
    if machine is None:
        machine = Machine(study_id=study_id, name=name, created_at=now)
        db.add(machine)
        db.flush()
    return machine


def _require_machine_environment(study: repository.StudyInfo) -> None:
    environments = study.plan.environments.values()
    if not any(one.is_machine and not one.is_crane_machine for one in environments):
        raise ConflictError(
            f"expected a study with an environment of source: machine, and {study.slug!r} has none"
        )
