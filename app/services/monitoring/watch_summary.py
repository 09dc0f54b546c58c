"""Summarises the playback events of one query, for exports and session pages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from app.storage.models.studies import Event

#: One value of the summary.
Value = str | float | int | bool | None

#: What a response was pressed with, and how the two videos stood.
DEVICES = frozenset({"mouse", "touch", "pen", "keyboard"})
LAYOUTS = frozenset({"side_by_side", "stacked"})

#: Events that the server adds when a query is set aside or a response undone: events before them do
#: not belong to the final answer.
CLOSINGS = frozenset({"set_aside", "undone"})


def summary(events: Sequence[Event]) -> tuple[Value, ...]:
    """The summary's columns in order (see `export.evidence`); all None without events."""
    closed = [place for place, event in enumerate(events) if event.event in CLOSINGS]
    events = events[closed[-1] + 1 :] if closed else events
    if not events:
        return (None,) * 16

    def of(name: str, side: str | None = None) -> list[Event]:
        return [event for event in events if event.event == name and side in (None, event.side)]

    return (
        _whole(_last(of("replays")), len(of("replay"))),
        _last(of("watched", "left")),
        _last(of("watched", "right")),
        _whole(_total(_last(of("dropped_frames", side)) for side in ("left", "right"))),
        len(of("stall")),
        _last(of("start_skew")),
        _last(of("worst_drift")),
        _last(of("width", "left")),
        _last(of("width", "right")),
        bool(of("hidden")),
        bool(of("blur")),
        any(_number(event.value) == 1 for event in of("fullscreen")),
        _one_of(DEVICES, of("pressed")),
        _one_of(LAYOUTS, of("layout")),
        len(of("turned")),
        len(of("resized")),
    )


def _one_of(known: frozenset[str], events: Sequence[Event]) -> str | None:
    """The last value, if it is a known one: a client may send anything."""
    value = events[-1].value if events else None
    return value if value in known else None


def _number(value: str | None) -> float | None:
    """An event's value as a number; None for anything else a client has sent."""
    try:
        number = float(value or "")
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _last(events: Sequence[Event]) -> float | None:
    return _number(events[-1].value) if events else None


def _total(numbers: Iterable[float | None]) -> float | None:
    known = [number for number in numbers if number is not None]
    return sum(known) if known else None


def _whole(number: float | None, otherwise: int | None = None) -> Value:
    return otherwise if number is None else int(number)
