"""The table `evidence`: a summary of the playback events of each answered query."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.monitoring.watch_summary import summary
from app.storage.models.studies import Event, QueryRow, Response, SessionRow, Trial
from app.study.plan import Plan

from .table import (
    QUERY,
    SESSION,
    TRIAL,
    Column,
    Request,
    Row,
    Table,
    at_trials_of,
    boolean,
    fetch,
    integer,
    number,
    of_trials,
    text,
)

#: A session's key in the database, a trial's index, a query's index.
Place = tuple[int, int, int]


def _columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        SESSION,
        TRIAL,
        QUERY,
        integer("replays", "How often both videos were played again."),
        number("left_watched", "Part of the left video that was played at least once, 0 to 1."),
        number("right_watched", "Part of the right video that was played at least once, 0 to 1."),
        integer("dropped_frames", "Frames that the browser dropped, of both videos."),
        integer("stalls", "How often a video halted because it had not arrived."),
        number("start_skew_ms", "How far apart the two first began to move.", "ms"),
        number("worst_drift_ms", "How far apart the two were at most while they played.", "ms"),
        number("left_width_px", "Width of the left video on the page.", "px"),
        number("right_width_px", "Width of the right video on the page.", "px"),
        boolean("hidden", "Whether the page was hidden at some time, as by another tab."),
        boolean("blurred", "Whether the window lost the focus at some time."),
        boolean("fullscreen", "Whether the pair was enlarged at some time."),
        text("pressed_with", "What it was answered with: mouse, touch, pen or keyboard."),
        text("layout", "How the videos stood when it was answered: side_by_side or stacked."),
        integer("turns", "How often the device was turned."),
        integer("resizes", "How often the page got another size, by turning or a window's edge."),
    )


def _rows(db: Session, request: Request) -> Iterator[Row]:
    seen = _events_by_place(db, request)
    at, events = next(seen, (None, ()))
    answered = of_trials(
        select(SessionRow.id, SessionRow.public_id, Trial.trial_index, QueryRow.query_index)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .join(Response, Response.query_id == QueryRow.id),
        request,
    ).order_by(SessionRow.id, Trial.trial_index, QueryRow.query_index)
    for session_id, public_id, trial_index, query_index in fetch(db, answered):
        place = (session_id, trial_index, query_index)
        # Both are sorted alike, so each is read once.
        while at is not None and at < place:
            at, events = next(seen, (None, ()))
        yield (public_id, trial_index, query_index, *summary(events if at == place else ()))


def _events_by_place(
    db: Session, request: Request
) -> Iterator[tuple[Place | None, Sequence[Event]]]:
    statement = (
        select(SessionRow.id, Event)
        .join(SessionRow, Event.session_id == SessionRow.id)
        .where(*at_trials_of(request, Event.session_id, Event.trial_index))
        .order_by(SessionRow.id, Event.trial_index, Event.query_index, Event.id)
    )

    def place(row: tuple[int, Event]) -> Place:
        return row[0], row[1].trial_index, row[1].query_index

    for at, rows in groupby(fetch(db, statement), key=place):
        yield at, [event for _, event in rows]


PLAYBACK = Table(
    "evidence",
    "How each answered query was watched: playback, size, focus.",
    _columns,
    _rows,
)
