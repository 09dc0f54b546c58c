"""Two sessions at once, and whether each is told what must be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import Any

import httpx

from app.services.context import AppContext
from tests.conftest import Clock
from tests.functional.client import Api

from .person import Person


@dataclass(frozen=True)
class World:
    """Where the sessions are. restart: another studio over the same database."""

    client: Api
    clock: Clock
    api_token: str
    restart: Callable[[], AppContext]


class Seats:
    """Who is here: two people, and whoever comes after them."""

    def __init__(self, world: World) -> None:
        self.world, self.client, self.clock = world, world.client, world.clock
        self.people: list[Person] = []
        self.deleted_at: list[str] = []
        self.here: list[Person] = []
        self.number = count(1).__next__

    def arrive(self) -> Person:
        name = f"person-{self.number()}-of-this-study"
        session = self.client.start(external_ids={"PROLIFIC_PID": name})
        person = Person(name, session, self.clock.now())
        self.people.append(person)
        return person

    def call(self, person: Person, step: str, body: Any = None) -> httpx.Response:
        return person.session.call(step, body)

    def send(self, person: Person, query_id: str, response: str, rt_ms: int) -> httpx.Response:
        body = {"query_id": query_id, "response": response, "rt_ms": rt_ms}
        return self.call(
            person, "responses", {**body, "events": [{"event": "stall", "time_ms": rt_ms}]}
        )

    def look(self, person: Person) -> None:
        path = "/api/v1/session"
        answer = self.client.get(path, headers=person.session.headers)
        if not self.kept_out(person, answer):
            self.taken(person, answer)

    def kept_out(self, person: Person, answer: httpx.Response) -> bool:
        """Whether the token is worth nothing (any more)."""
        gone, expired = person.ended == "deleted", person.expired(self.clock.now())
        if gone or expired:
            kind = "unauthenticated" if gone else "session-expired"
            assert (answer.status_code, kind_of(answer)) == (401, kind), answer.text
        return gone or expired

    def is_in(self, person: Person, answer: httpx.Response, *stages: str) -> bool:
        """Whether the session is in one of these; elsewhere it was told that it is not."""
        if self.kept_out(person, answer):
            return False
        if person.stage not in stages:
            self.refused(person, answer, "out-of-order")
        return person.stage in stages

    def refused(self, person: Person, answer: httpx.Response, kind: str, status: int = 409) -> None:
        if self.kept_out(person, answer):
            return
        assert (answer.status_code, kind_of(answer)) == (status, kind), (person.stage, answer.text)
        if status != 404:
            assert answer.json()["stage"] == person.stage

    def moved(self, person: Person, answer: httpx.Response) -> None:
        person.go_on(self.clock.now())
        self.taken(person, answer)

    def taken(self, person: Person, answer: httpx.Response) -> None:
        """The answer tells where the model has the session."""
        assert answer.status_code == 200, (person.stage, answer.text)
        state = person.session.state = answer.json()
        assert (state["stage"], state["progress"]) == (person.stage, person.progress())
        assert ("query" in state) == person.is_asked
        if not person.is_asked:
            return
        query = state["query"]
        if person.at not in person.standing:
            assert query["id"] not in {*person.set_aside, *person.gone, *person.standing.values()}
            person.standing[person.at] = query["id"]
        assert query["id"] == person.standing[person.at]
        assert query.get("undo") == person.offered_to_take_back(self.clock.now())


def kind_of(answer: httpx.Response) -> str:
    assert answer.headers["content-type"] == "application/problem+json", answer.text
    return str(answer.json()["type"]).removeprefix("urn:pbpo-studio:problem:")
