"""What machines report of a rollout: failed, unsafe, given back, and the machine's own numbers."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Final

from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, LeaseLostError
from app.storage.models.rollouts import Machine, Rollout

from . import claims, outcomes, states
from .machines import MachineCaller

#: Characters of a reason.
LONGEST_REASON: Final = 2_000
#: Bytes of `series` as JSON.
LARGEST_SERIES: Final = 500_000


def failed(
    app: AppContext,
    caller: MachineCaller,
    public_id: str,
    reason: str,
    *,
    attempt: int | None = None,
    give_back: bool = False,
) -> str:
    """End an attempt as failed; return the rollout's status, `asked` while attempts remain.

    The same report again changes nothing. give_back: the machine was stopped before it could try,
    so that the attempt does not count. Raises NotFoundError, or LeaseLostError if the machine does
    not hold the rollout any more.
    """
    with app.database.write() as db:
        rollout = outcomes.locked(db, caller.study_id, public_id)
        if not claims.holds(rollout, caller, attempt):
            if _is_reported(rollout, caller, attempt, reason):
                return rollout.status
            raise LeaseLostError(claims.who_has(rollout))
        if give_back:
            outcomes.ask_again(db, rollout)
        else:
            fail_attempt(app, db, rollout, caller, reason)
        return rollout.status


def fail_attempt(
    app: AppContext, db: Session, rollout: Rollout, caller: MachineCaller, reason: str
) -> None:
    """As `failed`, for a locked rollout that the machine holds."""
    outcomes.fail(
        db,
        rollout,
        machine=db.get_one(Machine, caller.machine_id),
        reason=reason[:LONGEST_REASON],
        attempts=claims.attempts_of(claims.plan_of(db, caller.study_id), rollout),
        now=app.now(),
    )


def unsafe(app: AppContext, caller: MachineCaller, public_id: str, reason: str) -> None:
    """End a rollout as unsafe, for good: its candidate is never proposed again.

    A machine that has lost its lease may report it as well, and a cancelled rollout becomes unsafe,
    since what was learnt of the parameters is true whoever holds the rollout. The same report again
    changes nothing. Raises NotFoundError, or ConflictError for a rollout that was recorded: the
    report is then kept with its failures.
    """
    with app.database.write() as db:
        rollout = outcomes.locked(db, caller.study_id, public_id)
        if rollout.status == states.UNSAFE:
            return
        is_recorded = rollout.status in (states.RECORDED, states.WITHDRAWN)
        if is_recorded:
            entry = {
                "attempt": rollout.attempt,
                "machine": caller.name,
                "at": app.now().isoformat(),
                "reason": f"unsafe: {reason[:LONGEST_REASON]}",
            }
            rollout.failures = [*rollout.failures, entry]
        else:
            outcomes.mark_unsafe(rollout, caller.machine_id, reason[:LONGEST_REASON], app.now())
    if is_recorded:
        raise ConflictError(
            "expected a rollout that is not recorded, and it is: the report is kept with it, and an"
            " experimenter may withdraw the recording"
        )


def measured(
    app: AppContext,
    caller: MachineCaller,
    public_id: str,
    *,
    score: float | None,
    series: Mapping[str, Any] | None,
    attempt: int | None = None,
) -> None:
    """Store the machine's own numbers on the run, in place of earlier ones.

    They are exported, and reach neither evaluators nor the optimiser. score: finite. series: a JSON
    object of at most `LARGEST_SERIES` bytes with finite numbers. Raises NotFoundError,
    LeaseLostError, or ConflictError for other values.
    """
    if score is not None and not math.isfinite(score):
        raise ConflictError(f"expected a finite score, got {score}")
    if series is not None:
        _check(series)
    with app.database.write() as db:
        rollout = claims.held(db, caller, public_id, attempt)
        rollout.score = score
        rollout.series = None if series is None else dict(series)


def _check(series: Mapping[str, Any]) -> None:
    try:
        size = len(json.dumps(series, allow_nan=False, separators=(",", ":")))
    except ValueError:
        raise ConflictError("expected finite numbers in series, got one that is not") from None
    if size > LARGEST_SERIES:
        raise ConflictError(f"expected a series of at most {LARGEST_SERIES:,} bytes, got {size:,}")


def _is_reported(rollout: Rollout, caller: MachineCaller, attempt: int | None, reason: str) -> bool:
    """Whether this very report has arrived before."""
    last = rollout.failures[-1] if rollout.failures else {}
    return (
        last.get("machine") == caller.name
        and last.get("reason") == reason[:LONGEST_REASON]
        and attempt in (None, last.get("attempt"))
    )
