"""Recovery of tasks whose worker stopped sending heartbeats: killed, or cut off from the queue."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

from sqlalchemy import Integer, exists, func, literal_column, select, update
from sqlalchemy.orm import Session

from .procrastinate_tables import FAILED, FAULT, LOST, RUNNING, TASKS, WAITING, WORKERS, is_in


@dataclass(frozen=True)
class StalledTask:
    """A task whose worker was lost.

    times: how many workers were lost while running it. is_over: whether it has failed for good.
    """

    name: str
    argument: str
    times: int
    is_over: bool

    @property
    def fault(self) -> str:
        """Why the task failed, if it is over."""
        return f"it was given up after {self.times} workers were lost at it"


def requeue_stalled(db: Session, silent_s: float, most: int) -> list[StalledTask]:
    """Requeue the running tasks of workers without a heartbeat for `silent_s` seconds.

    Each loss is counted once, however many workers call this. A task lost `most` times fails.
    """
    is_heard_of = exists().where(
        WORKERS.c.id == TASKS.c.worker_id,
        WORKERS.c.last_heartbeat > func.now() - timedelta(seconds=silent_s),
    )
    other = TASKS.alias()
    # A retention task can be running while the next one is waiting.
    has_a_twin = exists().where(
        other.c.queueing_lock == TASKS.c.queueing_lock, is_in(WAITING, other)
    )
    times = func.coalesce(TASKS.c.args[LOST].astext, "0").cast(Integer) + 1
    found = db.execute(
        select(TASKS.c.id, TASKS.c.task_name, TASKS.c.args["argument"].astext, times, has_a_twin)
        .where(is_in(RUNNING), ~is_heard_of)
        .with_for_update(of=TASKS, skip_locked=True)
    ).all()
    return [
        _requeue(db, task_id, StalledTask(name, argument or "", times, times >= most or twin))
        for task_id, name, argument, times, twin in found
    ]


def _requeue(db: Session, task_id: int, lost: StalledTask) -> StalledTask:
    noted: dict[str, object] = {LOST: lost.times}
    if lost.is_over:
        noted[FAULT] = lost.fault
    db.execute(
        update(TASKS)
        .where(TASKS.c.id == task_id)
        .values(
            status=literal_column(f"'{FAILED if lost.is_over else WAITING}'"),
            args=TASKS.c.args.concat(noted),
            attempts=TASKS.c.attempts + 1,
        )
    )
    return lost
