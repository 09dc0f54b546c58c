"""Sessions of one study, driven by any actions in any order, right and wrong ones.

After each action every session must be where `person` says, and in the end what is stored and
exported must be what was acknowledged, once, and nothing else.
"""

from __future__ import annotations

from datetime import timedelta

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from tests.conftest import STARTED

from .kept import compare, delete_all_people
from .person import COURSE, PLACES, TO_WATCH, VIDEOS
from .told import Seats, World, kind_of

#: Steps of time: within and beyond what may be undone, a break, a lease, and a session's life.
WAITS_S = (1, 1, 4, 4, 9, 30, 61, 61, 1801, 1801, 86_401)

Who = st.integers(0, 1)
Which = st.integers(0, 10)
#: Further than to a place of the course: chance alone would hardly come there.
Ahead = st.integers(0, len(COURSE) - 1)
Choice = st.sampled_from(["left", "right", "skip"])
AtTheQuery = st.sampled_from(["press", "press", "take back", "take back", "did not play"])
#: Whoever has left has little more to do: one of these is enough.
Seldom = st.sampled_from([True, False, False])


class Passage(RuleBasedStateMachine):
    """Two people at once, and whoever comes after them."""

    def __init__(self, world: World) -> None:
        super().__init__()
        self.world, self.clock = world, world.clock
        self.seats = Seats(world)
        self.looks = 0

    @initialize(ahead=st.tuples(Ahead, Ahead), response=Choice)
    def begin(self, ahead: tuple[int, int], response: str) -> None:
        self.clock.time = STARTED
        self.app = self.world.restart()
        delete_all_people(self.app)
        self.seats.here += [self.seats.arrive(), self.seats.arrive()]
        for who, steps in enumerate(ahead):
            self.do_what_is_asked(who, steps, response)

    def teardown(self) -> None:
        if self.seats.here:
            compare(self.app, self.seats)

    @invariant()
    def they_are_where_they_should_be(self) -> None:
        """By turns: a look at both after each step would take most of the time."""
        self.looks += 1
        if self.seats.here:
            self.seats.look(self.seats.here[self.looks % 2])

    # What evaluators do

    @rule(who=Who)
    def come(self, who: int) -> None:
        """Somebody else takes this seat; whoever sat there never comes back."""
        held = sum(person.holds_a_place(self.clock.now()) for person in self.seats.people)
        if held < PLACES:
            self.seats.here[who] = self.seats.arrive()
        else:
            answer = self.seats.client.post("/api/v1/studies/short/sessions", json={})
            assert (answer.status_code, kind_of(answer)) == (409, "study-full")

    @rule(who=Who, right=st.booleans())
    def consent(self, who: int, right: bool) -> None:
        person = self.seats.here[who]
        if not right:
            wrong = self.seats.call(person, "consent", {"version": "0" * 12})
            self.seats.refused(
                person, wrong, "stale-consent" if person.stage == "consent" else "out-of-order"
            )
            return
        version = person.session.state.get("consent", {}).get("version", "0" * 12)
        answer = self.seats.call(person, "consent", {"version": version})
        if self.seats.is_in(person, answer, "consent"):
            self.seats.moved(person, answer)

    @rule(who=Who)
    def go_on(self, who: int) -> None:
        person = self.seats.here[who]
        answer = self.seats.call(person, "continue")
        if not self.seats.is_in(
            person, answer, "instructions", "familiarisation", "break", "debrief"
        ):
            return
        if person.stage == "familiarisation" and len(person.watched) < TO_WATCH:
            self.seats.refused(person, answer, "watch-more")
        elif person.break_ends is not None and self.clock.now() < person.break_ends:
            self.seats.refused(person, answer, "break-not-over")
        else:
            self.seats.moved(person, answer)

    @rule(who=Who, index=st.integers(0, VIDEOS))
    def watch(self, who: int, index: int) -> None:
        person = self.seats.here[who]
        answer = self.seats.call(person, "watched", {"index": index})
        if not self.seats.is_in(person, answer, "familiarisation"):
            return
        if index >= VIDEOS:
            self.seats.refused(person, answer, "not-found", 404)
            return
        person.watched.add(index)
        person.heard = self.clock.now()
        self.seats.taken(person, answer)

    @rule(who=Who, response=Choice)
    def respond(self, who: int, response: str) -> None:
        """To the open query, or to the last one that was."""
        person = self.seats.here[who]
        query_id = person.standing.get(person.at, "none")
        rt_ms = self.seats.number()
        answer = self.seats.send(person, query_id, response, rt_ms)
        if person.over or person.expired(self.clock.now()) or not person.is_asked:
            self.seats.is_in(person, answer, "practice", "query")
        elif response == "skip" and COURSE[person.at].finished == 1:
            self.seats.refused(person, answer, "skip-not-offered")
        else:
            person.press(response, rt_ms, self.clock.now())
            person.events += 1
            self.seats.taken(person, answer)

    @rule(who=Who, which=Which, response=Choice)
    def respond_again(self, who: int, which: int, response: str) -> None:
        """To a query that was answered before: the same again, or another response."""
        person = self.seats.here[who]
        if not person.pressed:
            return
        query_id = list(person.pressed)[-1 - which % len(person.pressed)]
        answer = self.seats.send(person, query_id, response, self.seats.number())
        if self.seats.kept_out(person, answer):
            return
        if response == person.pressed[query_id].response:
            self.seats.taken(person, answer)
        else:
            self.seats.refused(person, answer, "already-answered")

    @rule(who=Who, which=Which, step=st.sampled_from(["responses", "undo", "faults"]))
    def name_a_query_that_is_not_open(self, who: int, which: int, step: str) -> None:
        """Of another session, or gone, or made up."""
        person, other = self.seats.here[who], self.seats.here[1 - who]
        unknown = [*other.standing.values(), *other.set_aside, *person.gone, "made-up", "\u200e"]
        body = {"query_id": unknown[which % len(unknown)]}
        answer = self.seats.call(
            person, step, {**body, "response": "left"} if step == "responses" else body
        )
        if self.seats.is_in(person, answer, "practice", "query"):
            self.seats.refused(person, answer, "not-found", 404)

    @rule(who=Who, which=Which)
    def respond_to_what_was_set_aside(self, who: int, which: int) -> None:
        person = self.seats.here[who]
        if person.set_aside:
            query_id = list(person.set_aside)[which % len(person.set_aside)]
            answer = self.seats.send(person, query_id, "left", self.seats.number())
            if not self.seats.kept_out(person, answer):
                self.seats.refused(person, answer, "set-aside")

    @rule(who=Who, which=st.integers(0, 3))
    def undo(self, who: int, which: int) -> None:
        """The last response, or an earlier one, or of the open query."""
        person = self.seats.here[who]
        ids = [*list(person.standing.values())[::-1], *person.set_aside]
        if not ids:
            return
        query_id = ids[which % len(ids)]
        may = person.may_take_back(query_id, self.clock.now())
        again = query_id not in person.pressed and query_id in [ids for ids, _ in person.undone]
        answer = self.seats.call(person, "undo", {"query_id": query_id})
        if self.seats.kept_out(person, answer):
            return
        if may:
            person.take_back(self.clock.now())
        if may or again:
            self.seats.taken(person, answer)
        else:
            self.seats.refused(person, answer, "too-late-to-undo")

    @rule(who=Who, which=st.integers(0, 2))
    def report_a_fault(self, who: int, which: int) -> None:
        """Of the open query, or of one that was answered or set aside before."""
        person = self.seats.here[who]
        ids = [*list(person.standing.values())[::-1], *person.set_aside]
        if not ids:
            return
        query_id = ids[which % len(ids)]
        answer = self.seats.call(person, "faults", {"query_id": query_id, "reason": "decode"})
        if self.seats.kept_out(person, answer):
            return
        if query_id in person.set_aside:
            self.seats.taken(person, answer)
        elif query_id in person.pressed:
            self.seats.refused(person, answer, "already-answered")
        elif self.seats.is_in(person, answer, "practice", "query"):
            person.set_open_aside(self.clock.now())
            self.seats.taken(person, answer)

    @rule(who=Who, right=st.booleans())
    def answer_the_questionnaire(self, who: int, right: bool) -> None:
        person = self.seats.here[who]
        at_the_end = person.place.query == 1
        item, value = ("age", 40) if at_the_end else ("effort", 3)
        answer = self.seats.call(
            person, "questionnaire", {"answers": {item: value if right else "much"}}
        )
        if not self.seats.is_in(person, answer, "questionnaire"):
            return
        if right:
            trial = -1 if at_the_end else person.place.finished - 1
            person.answers.append((trial, item, value))
            self.seats.moved(person, answer)
        else:
            self.seats.refused(person, answer, "answers-refused", 422)

    @rule(who=Who)
    def screen_out(self, who: int) -> None:
        """This study checks no device."""
        person = self.seats.here[who]
        self.seats.is_in(person, self.seats.call(person, "screen-out"))

    @rule(who=Who, really=Seldom)
    def withdraw(self, who: int, really: bool) -> None:
        if not really:
            return
        person = self.seats.here[who]
        answer = self.seats.call(person, "withdraw")
        if self.seats.kept_out(person, answer):
            return
        if person.over:
            self.seats.refused(person, answer, "out-of-order")
            return
        person.ended = "declined" if person.stage == "consent" else "withdrawn"
        self.seats.taken(person, answer)

    @rule(who=Who, really=Seldom)
    def withdraw_and_delete(self, who: int, really: bool) -> None:
        if not really:
            return
        person = self.seats.here[who]
        answer = self.seats.call(person, "withdraw", {"delete": True})
        if person.ended == "deleted":
            self.seats.kept_out(person, answer)
            return
        assert answer.status_code == 200, answer.text
        assert answer.json()["deleted"] is True
        self.seats.deleted_at.append(person.stage)
        person.ended = "deleted"

    @rule(who=Who, steps=st.integers(1, 4), response=Choice)
    def do_what_is_asked(self, who: int, steps: int, response: str) -> None:
        person = self.seats.here[who]
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

    @rule(who=Who, steps=st.lists(AtTheQuery, min_size=2, max_size=8), response=Choice)
    def change_their_mind(self, who: int, steps: list[str], response: str) -> None:
        """Quickly, at the pairs: on, back, on again."""
        for step in steps:
            if step == "press":
                self.respond(who, response)
            elif step == "take back":
                self.undo(who, 1)
            else:
                self.report_a_fault(who, 0)

    # What happens to them

    @rule(seconds=st.sampled_from(WAITS_S))
    def time_passes(self, seconds: int) -> None:
        self.clock.time += timedelta(seconds=seconds)

    @rule()
    def the_server_starts_again(self) -> None:
        self.app = self.world.restart()
