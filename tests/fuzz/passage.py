"""Sessions of one study, driven by any actions in any order, right and wrong ones.

After each action every session must be where `person` says, and in the end what is stored and
exported must be what was acknowledged, once, and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from itertools import count
from typing import Any

import httpx
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from app.services.studio import Studio
from tests.conftest import STARTED, Clock
from tests.functional.client import Api

from .kept import compare, delete_all_people
from .person import COURSE, PLACES, TO_WATCH, VIDEOS, Person


@dataclass(frozen=True)
class World:
    """Where the sessions are. restart: another studio over the same database."""

    client: Api
    clock: Clock
    api_token: str
    restart: Callable[[], Studio]


#: Steps of time: within and beyond what may be undone, a break, a lease, and a session's life.
WAITS_S = (1, 4, 9, 30, 61, 1801, 86_401)

Who = st.integers(0, 1)
Which = st.integers(0, 10)
#: Further than to a place of the course: chance alone would hardly come there.
Ahead = st.integers(0, len(COURSE) - 1)
Choice = st.sampled_from(["left", "right", "skip"])


class Passage(RuleBasedStateMachine):
    """Two people at once, and whoever comes after them."""

    def __init__(self, world: World) -> None:
        super().__init__()
        self.world, self.client, self.clock = world, world.client, world.clock
        self.people: list[Person] = []
        self.deleted_at: list[str] = []
        self.here: list[Person] = []
        self.looks = 0

    @initialize(ahead=st.tuples(Ahead, Ahead), response=Choice)
    def begin(self, ahead: tuple[int, int], response: str) -> None:
        self.clock.time = STARTED
        self.studio = self.world.restart()
        delete_all_people(self.studio)
        self.number = count(1).__next__
        self.here += [self._arrive(), self._arrive()]
        for who, steps in enumerate(ahead):
            self.do_what_is_asked(who, steps, response)

    def teardown(self) -> None:
        if self.here:
            compare(self.studio, self.client, self.world.api_token, self.people, self.deleted_at)

    @invariant()
    def they_are_where_they_should_be(self) -> None:
        """By turns: a look at both after each step would take most of the time."""
        self.looks += 1
        if self.here:
            self._look(self.here[self.looks % 2])

    # What evaluators do

    @rule(who=Who)
    def come(self, who: int) -> None:
        """Somebody else takes this seat; whoever sat there never comes back."""
        held = sum(person.holds_a_place(self.clock.now()) for person in self.people)
        if held < PLACES:
            self.here[who] = self._arrive()
        else:
            answer = self.client.post("/api/v1/studies/short/sessions", json={})
            assert (answer.status_code, _kind(answer)) == (409, "study-full")

    @rule(who=Who, right=st.booleans())
    def consent(self, who: int, right: bool) -> None:
        person = self.here[who]
        if not right:
            wrong = self._call(person, "consent", {"version": "0" * 12})
            self._refused(
                person, wrong, "stale-consent" if person.stage == "consent" else "out-of-order"
            )
            return
        version = person.session.state.get("consent", {}).get("version", "0" * 12)
        answer = self._call(person, "consent", {"version": version})
        if self._is_in(person, answer, "consent"):
            self._moved(person, answer)

    @rule(who=Who)
    def go_on(self, who: int) -> None:
        person = self.here[who]
        answer = self._call(person, "continue")
        if not self._is_in(person, answer, "instructions", "familiarisation", "break", "debrief"):
            return
        if person.stage == "familiarisation" and len(person.watched) < TO_WATCH:
            self._refused(person, answer, "watch-more")
        elif person.break_ends is not None and self.clock.now() < person.break_ends:
            self._refused(person, answer, "break-not-over")
        else:
            self._moved(person, answer)

    @rule(who=Who, index=st.integers(0, VIDEOS))
    def watch(self, who: int, index: int) -> None:
        person = self.here[who]
        answer = self._call(person, "watched", {"index": index})
        if not self._is_in(person, answer, "familiarisation"):
            return
        if index >= VIDEOS:
            self._refused(person, answer, "not-found", 404)
            return
        person.watched.add(index)
        person.heard = self.clock.now()
        self._taken(person, answer)

    @rule(who=Who, response=Choice)
    def respond(self, who: int, response: str) -> None:
        """To the open query, or to the last one that was."""
        person = self.here[who]
        query_id = person.standing.get(person.at, "none")
        rt_ms = self.number()
        answer = self._send(person, query_id, response, rt_ms)
        if person.over or person.expired(self.clock.now()) or not person.is_asked:
            self._is_in(person, answer, "practice", "query")
        elif response == "skip" and COURSE[person.at].finished == 1:
            self._refused(person, answer, "skip-not-offered")
        else:
            person.press(response, rt_ms, self.clock.now())
            person.events += 1
            self._taken(person, answer)

    @rule(who=Who, which=Which, response=Choice)
    def respond_again(self, who: int, which: int, response: str) -> None:
        """To a query that was answered before: the same again, or another response."""
        person = self.here[who]
        if not person.pressed:
            return
        query_id = list(person.pressed)[-1 - which % len(person.pressed)]
        answer = self._send(person, query_id, response, self.number())
        if self._kept_out(person, answer):
            return
        if response == person.pressed[query_id].response:
            self._taken(person, answer)
        else:
            self._refused(person, answer, "already-answered")

    @rule(who=Who, which=Which, step=st.sampled_from(["responses", "undo", "faults"]))
    def name_a_query_that_is_not_open(self, who: int, which: int, step: str) -> None:
        """Of another session, or gone, or made up."""
        person, other = self.here[who], self.here[1 - who]
        unknown = [*other.standing.values(), *other.set_aside, *person.gone, "made-up", "\u200e"]
        body = {"query_id": unknown[which % len(unknown)]}
        answer = self._call(
            person, step, {**body, "response": "left"} if step == "responses" else body
        )
        if self._is_in(person, answer, "practice", "query"):
            self._refused(person, answer, "not-found", 404)

    @rule(who=Who, which=Which)
    def respond_to_what_was_set_aside(self, who: int, which: int) -> None:
        person = self.here[who]
        if person.set_aside:
            query_id = list(person.set_aside)[which % len(person.set_aside)]
            answer = self._send(person, query_id, "left", self.number())
            if not self._kept_out(person, answer):
                self._refused(person, answer, "set-aside")

    @rule(who=Who, which=st.integers(0, 3))
    def undo(self, who: int, which: int) -> None:
        """The last response, or an earlier one, or of the open query."""
        person = self.here[who]
        ids = [*list(person.standing.values())[::-1], *person.set_aside]
        if not ids:
            return
        query_id = ids[which % len(ids)]
        may = person.may_take_back(query_id, self.clock.now())
        again = query_id not in person.pressed and query_id in [ids for ids, _ in person.undone]
        answer = self._call(person, "undo", {"query_id": query_id})
        if self._kept_out(person, answer):
            return
        if may:
            person.take_back(self.clock.now())
        if may or again:
            self._taken(person, answer)
        else:
            self._refused(person, answer, "too-late-to-undo")

    @rule(who=Who, which=st.integers(0, 2))
    def report_a_fault(self, who: int, which: int) -> None:
        """Of the open query, or of one that was answered or set aside before."""
        person = self.here[who]
        ids = [*list(person.standing.values())[::-1], *person.set_aside]
        if not ids:
            return
        query_id = ids[which % len(ids)]
        answer = self._call(person, "faults", {"query_id": query_id, "reason": "decode"})
        if self._kept_out(person, answer):
            return
        if query_id in person.set_aside:
            self._taken(person, answer)
        elif query_id in person.pressed:
            self._refused(person, answer, "already-answered")
        elif self._is_in(person, answer, "practice", "query"):
            person.set_open_aside(self.clock.now())
            self._taken(person, answer)

    @rule(who=Who, right=st.booleans())
    def answer_the_questionnaire(self, who: int, right: bool) -> None:
        person = self.here[who]
        at_the_end = person.place.query == 1
        item, value = ("age", 40) if at_the_end else ("effort", 3)
        answer = self._call(
            person, "questionnaire", {"answers": {item: value if right else "much"}}
        )
        if not self._is_in(person, answer, "questionnaire"):
            return
        if right:
            trial = -1 if at_the_end else person.place.finished - 1
            person.answers.append((trial, item, value))
            self._moved(person, answer)
        else:
            self._refused(person, answer, "answers-refused", 422)

    @rule(who=Who)
    def screen_out(self, who: int) -> None:
        """This study checks no device."""
        person = self.here[who]
        self._is_in(person, self._call(person, "screen-out"))

    @rule(who=Who)
    def withdraw(self, who: int) -> None:
        person = self.here[who]
        answer = self._call(person, "withdraw")
        if self._kept_out(person, answer):
            return
        if person.over:
            self._refused(person, answer, "out-of-order")
            return
        person.ended = "declined" if person.stage == "consent" else "withdrawn"
        self._taken(person, answer)

    @rule(who=Who)
    def withdraw_and_delete(self, who: int) -> None:
        person = self.here[who]
        answer = self._call(person, "withdraw", {"delete": True})
        if person.ended == "deleted":
            self._kept_out(person, answer)
            return
        assert answer.status_code == 200, answer.text
        assert answer.json()["deleted"] is True
        self.deleted_at.append(person.stage)
        person.ended = "deleted"

    @rule(who=Who, steps=st.integers(1, 4), response=Choice)
    def do_what_is_asked(self, who: int, steps: int, response: str) -> None:
        person = self.here[who]
        for _ in range(steps):
            match person.stage:
                case "consent":
                    self.consent(who, right=True)
                case "familiarisation":
                    self.watch(who, 0)
                    self.go_on(who)
                case "practice" | "query":
                    offered = response != "skip" or person.place.finished == 0
                    self.respond(who, response if offered else "left")
                case "questionnaire":
                    self.answer_the_questionnaire(who, right=True)
                case "break":
                    self.time_passes(61)
                    self.go_on(who)
                case "instructions" | "debrief":
                    self.go_on(who)

    # What happens to them

    @rule(seconds=st.sampled_from(WAITS_S))
    def time_passes(self, seconds: int) -> None:
        self.clock.time += timedelta(seconds=seconds)

    @rule()
    def the_server_starts_again(self) -> None:
        self.studio = self.world.restart()

    # How it is told what came of it

    def _arrive(self) -> Person:
        name = f"person-{self.number()}-of-this-study"
        session = self.client.start(external_ids={"known_as": name})
        person = Person(name, session, self.clock.now())
        self.people.append(person)
        return person

    def _call(self, person: Person, step: str, body: Any = None) -> httpx.Response:
        return person.session.call(step, body)

    def _send(self, person: Person, query_id: str, response: str, rt_ms: int) -> httpx.Response:
        body = {"query_id": query_id, "response": response, "rt_ms": rt_ms}
        return self._call(
            person, "responses", {**body, "events": [{"event": "stall", "time_ms": rt_ms}]}
        )

    def _look(self, person: Person) -> None:
        path = "/api/v1/session"
        answer = self.client.get(path, headers=person.session.headers)
        if not self._kept_out(person, answer):
            self._taken(person, answer)

    def _kept_out(self, person: Person, answer: httpx.Response) -> bool:
        """Whether the token is worth nothing (any more)."""
        gone, expired = person.ended == "deleted", person.expired(self.clock.now())
        if gone or expired:
            kind = "unauthenticated" if gone else "session-expired"
            assert (answer.status_code, _kind(answer)) == (401, kind), answer.text
        return gone or expired

    def _is_in(self, person: Person, answer: httpx.Response, *stages: str) -> bool:
        """Whether the session is in one of these; elsewhere it was told that it is not."""
        if self._kept_out(person, answer):
            return False
        if person.stage not in stages:
            self._refused(person, answer, "out-of-order")
        return person.stage in stages

    def _refused(
        self, person: Person, answer: httpx.Response, kind: str, status: int = 409
    ) -> None:
        if self._kept_out(person, answer):
            return
        assert (answer.status_code, _kind(answer)) == (status, kind), (person.stage, answer.text)
        if status != 404:
            assert answer.json()["stage"] == person.stage

    def _moved(self, person: Person, answer: httpx.Response) -> None:
        person.go_on(self.clock.now())
        self._taken(person, answer)

    def _taken(self, person: Person, answer: httpx.Response) -> None:
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


def _kind(answer: httpx.Response) -> str:
    assert answer.headers["content-type"] == "application/problem+json", answer.text
    return str(answer.json()["type"]).removeprefix("urn:pbpo-studio:problem:")
