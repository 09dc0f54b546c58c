"""What must be of one session, said plainly: its course as a list of places, and what was pressed.

Nothing here asks the application: this is what it is held to.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

from tests.functional.client import Session

TRIALS, SHOWN, PRACTICE = 2, 4, 1
VIDEOS, TO_WATCH = 2, 1
BREAK = timedelta(seconds=60)
#: While the page offers to take a response back, and until the server still lets one.
UNDO, UNDO_GRACE = timedelta(seconds=5), timedelta(seconds=3)
PLACES, LEASE = 2, timedelta(minutes=30)
EXPIRES = timedelta(days=1)

PLAN = f"""
version: 1
slug: short
title: {{en: A short study}}
languages: [en]
parameters:
  - {{name: w0, label: Opening time, unit: s}}
  - {{name: w1, label: Closing time, unit: s}}
environments:
  env1: {{label: Clumps, source: crane}}
conditions:
  - name: pbpo
    method: pbpo
    environment: env1
    skip: {{label: {{en: Neither}}}}
    settings: {{preset: paper-env1, random_queries: 1}}
  - name: no-skip
    method: pbpo-no-skip
    environment: env1
    settings: {{preset: paper-env1, random_queries: 1}}
order: fixed
trials_per_condition: 1
queries_per_trial: 3
checks: {{repeats: 0.3}}
break_s: {BREAK.seconds}
familiarisation: {{videos: {VIDEOS}, required: {TO_WATCH}}}
practice: {{queries: {PRACTICE}}}
query: {{undo_s: {UNDO.seconds}}}
places: {PLACES}
lease_minutes: {LEASE.seconds // 60}
session_expires_after_days: {EXPIRES.days}
questionnaires:
  after_trial:
    - {{name: effort, type: likert, points: 7, label: "How hard was it?"}}
  end:
    - {{name: age, type: number, min: 1, max: 120, label: "How old are you?"}}
"""


@dataclass(frozen=True)
class Place:
    """Where a session can be. finished: how many trials are; query: 0-based, of those shown."""

    stage: str
    finished: int = 0
    query: int = 0

    @property
    def progress(self) -> dict[str, int]:
        """What STATE says of it."""
        if self.stage == "practice":
            return {"trial": 0, "trials": TRIALS, "query": self.query + 1, "queries": PRACTICE}
        trial, query = self.finished, SHOWN if self.finished else 0
        if self.stage == "query":
            trial, query = self.finished + 1, self.query + 1
        return {"trial": trial, "trials": TRIALS, "query": query, "queries": SHOWN}

    @property
    def trial(self) -> int:
        """The trial as exports count it: from 0, and -1 for the practice."""
        return -1 if self.stage == "practice" else self.finished


def _trial(index: int) -> list[Place]:
    return [Place("query", index, query) for query in range(SHOWN)]


COURSE = (
    Place("consent"),
    Place("instructions"),
    Place("familiarisation"),
    *(Place("practice", 0, query) for query in range(PRACTICE)),
    *_trial(0),
    Place("questionnaire", 1),
    Place("break", 1),
    *_trial(1),
    Place("questionnaire", 2, 0),
    Place("questionnaire", 2, 1),
    Place("debrief", 2),
    Place("completed", 2),
)


@dataclass(frozen=True)
class Pressed:
    """A response that was acknowledged."""

    at: int
    response: str
    rt_ms: int
    time: datetime


@dataclass
class Person:
    """One session and all that is known of it. `at` is its place in COURSE."""

    name: str
    session: Session
    now: datetime
    at: int = 0
    ended: str = ""
    break_ends: datetime | None = None
    watched: set[int] = field(default_factory=set)
    #: The query that stands at a place, by the id that the browser knows.
    standing: dict[int, str] = field(default_factory=dict)
    #: By the id of their query.
    pressed: dict[str, Pressed] = field(default_factory=dict)
    #: Queries that were set aside, by id: their places. And ids that went with a response undone.
    set_aside: dict[str, int] = field(default_factory=dict)
    gone: list[str] = field(default_factory=list)
    undone: list[tuple[str, Pressed]] = field(default_factory=list)
    answers: list[tuple[int, str, int]] = field(default_factory=list)
    #: Events that came with what was acknowledged.
    events: int = 0

    def __post_init__(self) -> None:
        self.heard = self.began = self.now

    @property
    def place(self) -> Place:
        return COURSE[self.at]

    @property
    def stage(self) -> str:
        return self.ended or self.place.stage

    @property
    def over(self) -> bool:
        return self.stage in ("completed", "withdrawn", "declined", "deleted")

    @property
    def is_asked(self) -> bool:
        return self.stage in ("practice", "query")

    def expired(self, now: datetime) -> bool:
        return not self.over and now >= self.began + EXPIRES

    def holds_a_place(self, now: datetime) -> bool:
        return self.stage == "completed" or (not self.over and self.heard >= now - LEASE)

    def progress(self) -> dict[str, int]:
        if self.ended:
            return Place(self.ended, self.place.finished).progress
        return self.place.progress

    def go_on(self, now: datetime) -> None:
        """To the next place of the course."""
        self.at += 1
        self.heard = now
        self.break_ends = now + BREAK if self.stage == "break" else None

    def press(self, response: str, rt_ms: int, now: datetime) -> None:
        self.pressed[self.standing[self.at]] = Pressed(self.at, response, rt_ms, now)
        self.go_on(now)

    def may_take_back(self, query_id: str, now: datetime) -> bool:
        """Only what was pressed last, soon, in this trial, and with nothing done since."""
        pressed = self.pressed.get(query_id)
        return (
            pressed is not None
            and self.stage == "query"
            and pressed.at == self.at - 1
            and COURSE[pressed.at].stage == "query"
            and not self._touched()
            and now < pressed.time + UNDO + UNDO_GRACE
        )

    def offered_to_take_back(self, now: datetime) -> dict[str, Any] | None:
        """What STATE says of that, for as long as the page counts."""
        last = self.standing.get(self.at - 1, "")
        if not self.may_take_back(last, now):
            return None
        left = (self.pressed[last].time + UNDO - now).total_seconds()
        return {"query_id": last, "seconds_left": round(left, 1)} if left > 0 else None

    def take_back(self, now: datetime) -> None:
        if self.at in self.standing:
            self.gone.append(self.standing.pop(self.at))
        self.at -= 1
        self.undone.append((self.standing[self.at], self.pressed.pop(self.standing[self.at])))
        self.heard = now
        self.events += 1

    def set_open_aside(self, now: datetime) -> None:
        self.set_aside[self.standing.pop(self.at)] = self.at
        self.heard = now
        self.events += 1

    def _touched(self) -> bool:
        """Whether something was done at the open query already."""
        taken_back = {query_id for query_id, _ in self.undone}
        return self.standing.get(self.at) in taken_back or self.at in self.set_aside.values()
