"""Recent incidents in a study, as sentences with their number, last time, and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import Select, func, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from app.services import jobs
from app.services.context import AppContext
from app.services.failure_counter import Kind
from app.services.rollouts import durations
from app.services.studies.repository import StudyInfo
from app.services.studies.session_modes import OF_PEOPLE
from app.storage.models.records import FaultCount, Job
from app.storage.models.studies import QueryRow, SessionRow, Trial

from . import clock

#: Older incidents are not shown.
SHOWN = timedelta(days=7)
#: Value of `trial_type` for a query whose model could not be fitted.
_NO_FIT = "random-fallback"
#: Names of the kinds of jobs in sentences.
_WORK = {"simulate": "A simulation", "ethics": "An ethics bundle"}
#: Failed jobs shown at the most.
_MOST_JOBS = 3


@dataclass(frozen=True)
class Incident:
    """One kind of incident: what happened, how often, when last, and what can be done."""

    name: str
    said: str
    last_at: datetime
    advice: str


_LOOK = "The server's log says why: look for errors at this time, or ask whoever runs the server."


@dataclass(frozen=True)
class _Said:
    """The sentences for one kind of failure: the counted noun, what happened, and what to do."""

    noun: str
    became: str
    advice: str


_SAID = {
    Kind.PAGE: _Said(
        "page",
        "of participants failed. They were told so, and how to come back.",
        _LOOK,
    ),
    Kind.CALL: _Said(
        "request",
        "of participants failed. Their pages send answers again until they are kept.",
        _LOOK,
    ),
    Kind.VIDEO: _Said(
        "video",
        "could not be sent. Another pair is shown where a video does not come.",
        "Most often the disk is full, a store of recordings is away, or no worker is there."
        f" {_LOOK}",
    ),
    Kind.DATABASE: _Said(
        "request",
        "came while the database was full, locked or away.",
        "See that the server's disk has room, and that its database runs. Nothing that was"
        " acknowledged is lost.",
    ),
    Kind.CROWDED: _Said(
        "request",
        "of newcomers came when too many had begun and answered nothing. They were told when to"
        " come back.",
        "If so many people did come, have PBPO_BEGUN_PER_HOUR raised. If not, a program may be"
        " beginning sessions: single-use links keep it out.",
    ),
    Kind.UNFILLED: _Said(
        "participant",
        "came by a link in which the platform's parameters were not filled in, such as"
        " {{%PROLIFIC_PID%}}. Nobody can be recognised by them, and they are not kept.",
        "If these were not colleagues who tried the link, look at the platform whether it fills the"
        " parameters in: at Prolific, choose URL parameters where it asks how ids are recorded.",
    ),
    Kind.UNREADABLE: _Said(
        "request",
        "was refused because a parameter of the platform came twice with different values, or was"
        " too long.",
        "Compare the link at the platform with the one under Recruit: each parameter stands in it"
        " once.",
    ),
    Kind.EVENTS: _Said(
        "event",
        "came beyond what is kept of a pair or of a session: counted, and left out. The answers"
        " that came with them are all there.",
        "The table of events has left_out where it was, with the number. A page sends far fewer: a"
        " program may be taking part, or a browser with a fault.",
    ),
    Kind.RETENTION: _Said(
        "hourly sweep",
        "of what this study has promised to delete failed. Some of it may be there still.",
        f"It is tried again every hour. {_LOOK}",
    ),
}


def incidents(app: AppContext, study: StudyInfo) -> list[Incident]:
    """The incidents of the last days in a study, the latest first."""
    app.failures.write()
    since = app.now() - SHOWN
    with app.database.read() as db:
        found = [
            *_counted(db, study.id, since),
            *_set_aside(db, study.id, since),
            *_unfitted(db, study.id, since),
            *_failed_jobs(db, study.id, since),
            *_machines(db, study.id, app.now()),
        ]
    found += _of_the_server(app)
    return sorted(found, key=lambda trouble: trouble.last_at, reverse=True)


def _counted(db: Session, study_id: int, since: datetime) -> Iterator[Incident]:
    rows = db.execute(
        select(FaultCount.kind, func.sum(FaultCount.number), func.max(FaultCount.last_at))
        .where(FaultCount.study_id == study_id, FaultCount.last_at > since)
        .group_by(FaultCount.kind)
        .order_by(FaultCount.kind)
    )
    for kind, number, last_at in rows:
        told = _SAID[Kind(kind)]
        yield Incident(kind, f"{_times(number, told.noun)} {told.became}", last_at, told.advice)


def _set_aside(db: Session, study_id: int, since: datetime) -> Iterator[Incident]:
    number, last_at = db.execute(
        _queries(study_id, QueryRow.set_aside_at, since).where(SessionRow.mode.in_(OF_PEOPLE))
    ).one()
    if last_at is not None:
        yield Incident(
            "set-aside",
            f"{_times(number, 'pair')} did not play and made way for another.",
            last_at,
            "The table of faults, in the data, names the videos. One that comes up again and again"
            " may be damaged; many at once speak of a slow line.",
        )


def _unfitted(db: Session, study_id: int, since: datetime) -> Iterator[Incident]:
    number, last_at = db.execute(
        _queries(study_id, QueryRow.created_at, since).where(QueryRow.acquisition == _NO_FIT)
    ).one()
    if last_at is not None:
        yield Incident(
            "no-fit",
            f"{_times(number, 'pair')} had to be drawn at random, since no model could be fitted.",
            last_at,
            "The study goes on. In the data such queries have the acquisition random-fallback."
            " Look at the settings of its conditions: the length scale first.",
        )


def _queries(study_id: int, at: InstrumentedAttribute[Any], since: datetime) -> Select[int, Any]:
    """Selects the number of a study's queries with `at` since then, and the latest `at`."""
    return (
        select(func.count(QueryRow.id), func.max(at))
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(SessionRow.study_id == study_id, SessionRow.last_seen_at > since, at > since)
    )


def _failed_jobs(db: Session, study_id: int, since: datetime) -> Iterator[Incident]:
    failed = db.scalars(
        select(Job)
        .where(Job.study_id == study_id, Job.state == jobs.FAILED, Job.ended_at > since)
        .order_by(Job.ended_at.desc())
        .limit(_MOST_JOBS)
    )
    for job in failed:
        if job.ended_at is not None:
            yield Incident(
                "job",
                f"{_WORK.get(job.kind, 'Work')} that was asked for failed: {job.message}.",
                job.ended_at,
                "Ask for it again. If it fails again, the server's log says more.",
            )


def _machines(db: Session, study_id: int, now: datetime) -> Iterator[Incident]:
    """Recordings that wait for a machine, because none is there or all are stopped."""
    for study in durations.unattended(db, now, study_id):
        waiting = _times(study.waiting, "recording")
        verb = "waits" if study.waiting == 1 else "wait"
        if study.is_stopped:
            yield Incident(
                "machines-stopped",
                f"The machines are stopped. {waiting} {verb} for them since {study.since:%H:%M}"
                " UTC.",
                now,
                "Release them when it is safe: evaluators see that a recording is awaited.",
            )
        else:
            yield Incident(
                "no-machine",
                f"No machine is heard of. {waiting} {verb} for one since {study.since:%H:%M} UTC.",
                now,
                "See that the machine runs and reaches the studio. Evaluators see that a recording"
                " is awaited, and may leave with the technical code.",
            )


def _of_the_server(app: AppContext) -> Iterator[Incident]:
    """Present problems of the server, which affect all studies."""
    queue = app.background.queue()
    if queue is not None and queue.workers == 0:
        yield Incident(
            "no-worker",
            "No worker is there. Videos that are not made yet do not come; simulations, ethics"
            " bundles and the deletion of what is due wait.",
            app.now(),
            "Have one started (pbpo worker), or ask whoever runs the server why none is there.",
        )
    behind = clock.clock_lag(app)
    if behind is not None:
        yield Incident(
            "clock",
            "The server's clock is behind: somebody was there"
            f" {clock.lag_in_words(behind)} later than it says now.",
            app.now(),
            "Have it set by the network's time. What begins meanwhile bears a wrong time, and may"
            " be over too soon. If it was ahead before, and is right now, nothing is left to do.",
        )


def _times(number: int, noun: str) -> str:
    return f"One {noun}" if number == 1 else f"{number:,} {noun}s"
