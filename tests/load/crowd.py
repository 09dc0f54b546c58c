"""Many evaluators at once, over HTTP: each does what the query page's scripts do.

An evaluator looks at a pair, fetches ahead what the server says may come, and answers; what was
acknowledged is kept, to be held against what the server stored. A request that gets no answer is
sent again, as the page does it, until it gets one.
"""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Self

import aiohttp
import numpy as np

State = dict[str, Any]

#: Seconds after a pair is shown at which the page asks what to fetch ahead (static/js/query.js).
ASK_AHEAD_S = (1.0, 2.0, 4.0, 8.0)
#: Videos that a page keeps, and fetches at the same time (static/js/preloader.js).
KEPT_VIDEOS, FETCHED_AT_ONCE = 14, 2
#: A pause before a request is sent again, in seconds; it grows to the second number.
AGAIN_S = (0.2, 2.0)
#: Seconds between two looks at a pair that a machine has to record (static/js/waiting_times.js).
LOOK_EVERY_S = 1.0
#: What people press, of twenty.
RESPONSES = ("left",) * 9 + ("right",) * 9 + ("skip",) * 2
#: How much the time that people take for a pair varies: the deviation of its logarithm.
THINKING_SPREAD = 0.4


@dataclass
class Log:
    """What a crowd saw. Times are in seconds."""

    #: From a response to the state with the next query, as one request takes.
    answer_s: list[float] = field(default_factory=list)
    #: The start of a video: one of its parts.
    video_s: list[float] = field(default_factory=list)
    #: From the moment at which somebody is ready for a pair until its videos are recorded; 0 where
    #: they are by then.
    wait_s: list[float] = field(default_factory=list)
    #: How often a request was answered by this status; 0: not at all.
    statuses: dict[int, int] = field(default_factory=dict)
    #: Any answer other than what was asked for, shortened.
    faults: list[str] = field(default_factory=list)
    #: What was acknowledged: by session's token, the query and what was pressed, in order.
    acknowledged: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    #: What was on its way when its evaluator left: session's token, query, what was pressed.
    in_hand: set[tuple[str, str, str]] = field(default_factory=set)
    videos: int = 0
    video_bytes: int = 0
    completed: int = 0
    #: Evaluators who are in a break just now.
    resting: int = 0

    def begin(self) -> None:
        """Measure from now on."""
        for times in (self.answer_s, self.video_s, self.wait_s):
            times.clear()
        self.videos = self.video_bytes = 0

    def fault(self, text: str) -> None:
        if len(self.faults) < 1000:
            self.faults.append(text[:300])


@dataclass(frozen=True)
class Habits:
    """How evaluators behave. think_s: mean time from a pair to the response."""

    think_s: float = 12.0
    videos: bool = True
    #: Whether a server that does not answer, or says 503, is waited for, or is a fault.
    patient: bool = False
    look_every_s: float = LOOK_EVERY_S


class Evaluator:
    """One person after another in one browser, session after session."""

    def __init__(self, url: str, slug: str, habits: Habits, log: Log, seed: int) -> None:
        self._url = url
        self._slug = slug
        self._habits = habits
        self._log = log
        self._rng = np.random.default_rng(seed)
        self._token = ""
        self._kept: OrderedDict[str, None] = OrderedDict()
        self._fetching = asyncio.Semaphore(FETCHED_AT_ONCE)

    async def __aenter__(self) -> Self:
        # Six connections to a host, as browsers have.
        connector = aiohttp.TCPConnector(limit=6, keepalive_timeout=15)
        timeout = aiohttp.ClientTimeout(total=60)
        self._http = aiohttp.ClientSession(self._url, connector=connector, timeout=timeout)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._http.close()

    async def take_part(self) -> None:
        """One session from its beginning to its end."""
        started = await self._api("POST", f"/api/v1/studies/{self._slug}/sessions", {})
        self._token, state = started["token"], started["session"]
        self._log.acknowledged[self._token] = []
        self._kept.clear()
        while state["stage"] not in ("completed", "withdrawn", "declined"):
            match state["stage"]:
                case "query":
                    state = await self._recorded(state)
                    if state["stage"] == "query":
                        state = await self._query(state["query"])
                case "consent":
                    agreed = {"version": state["consent"]["version"]}
                    state = await self._api("POST", "/api/v1/session/consent", agreed)
                case "break":
                    await self._rest(state["break"]["seconds_left"])
                    state = await self._api("POST", "/api/v1/session/continue", None)
                case _:
                    await asyncio.sleep(self._rng.uniform(1, 3))
                    state = await self._api("POST", "/api/v1/session/continue", None)
        self._log.completed += 1

    async def _recorded(self, state: State) -> State:
        """The state with a pair, once machines have recorded it."""
        began = time.monotonic()
        waited = 0.0
        while state["stage"] == "query" and state["query"] is None:
            await asyncio.sleep(self._habits.look_every_s)
            state = await self._api("GET", "/api/v1/session", None)
            waited = time.monotonic() - began
        self._log.wait_s.append(waited)
        return state

    async def _rest(self, seconds: float) -> None:
        self._log.resting += 1
        try:
            await asyncio.sleep(seconds)
        finally:
            self._log.resting -= 1

    async def _query(self, query: State) -> State:
        mean = self._habits.think_s
        # Of this mean: lognormal, as people's times are.
        spread = THINKING_SPREAD
        think_s = self._rng.lognormal(np.log(mean) - spread**2 / 2, spread)
        shown_at = time.monotonic()
        async with asyncio.TaskGroup() as looking:
            looking.create_task(self._watch([query["left"]["url"], query["right"]["url"]]))
            ahead = looking.create_task(self._look_ahead(query))
            await asyncio.sleep(think_s)
            # What is still fetched when somebody answers is let go of.
            ahead.cancel()
        response = str(self._rng.choice(RESPONSES))
        if response == "skip" and query["skip"] is None:
            response = "left"
        body = {
            "query_id": query["id"],
            "response": response,
            "rt_ms": round(1000 * (time.monotonic() - shown_at)),
        }
        in_hand = (self._token, query["id"], response)
        self._log.in_hand.add(in_hand)
        sent_at = time.monotonic()
        state = await self._api("POST", "/api/v1/session/responses", body)
        self._log.answer_s.append(time.monotonic() - sent_at)
        self._log.acknowledged[self._token].append((query["id"], response))
        self._log.in_hand.discard(in_hand)
        return state

    async def _look_ahead(self, query: State) -> None:
        coming = query["prefetch"]
        await self._fetch(coming)
        for seconds in ASK_AHEAD_S:
            if coming:
                return
            await asyncio.sleep(seconds)
            with suppress(RefusedError):
                now = await self._api("GET", "/api/v1/session", None)
                pair = now.get("query")
                if now["stage"] != "query" or pair is None or pair["id"] != query["id"]:
                    return
                coming = now["query"]["prefetch"]
                await self._fetch(coming)

    async def _watch(self, urls: Sequence[str]) -> None:
        """The pair itself; what was not fetched ahead is played by ranges."""
        for url in urls:
            if url in self._kept:
                self._kept.move_to_end(url)
            elif self._habits.videos:
                await self._video(url, {"Range": "bytes=0-"})

    async def _fetch(self, urls: Sequence[str]) -> None:
        if self._habits.videos:
            missing = [url for url in urls if url not in self._kept]
            await asyncio.gather(*(self._video(url, {}) for url in missing))

    async def _video(self, url: str, headers: dict[str, str]) -> None:
        async with self._fetching:
            began = time.monotonic()
            try:
                async with self._http.get(url, headers=headers) as answer:
                    self._count(answer.status)
                    if answer.status not in (200, 206):
                        # A video that cannot be had just now is asked for again.
                        if answer.status != 503 or not self._habits.patient:
                            self._log.fault(f"{answer.status} for a video")
                        return
                    first = await answer.content.readany()
                    self._log.video_s.append(time.monotonic() - began)
                    self._log.video_bytes += len(first) + len(await answer.read())
                    self._log.videos += 1
            except (aiohttp.ClientError, TimeoutError) as error:
                self._count(0)
                if not self._habits.patient:
                    self._log.fault(f"{type(error).__name__} for a video")
                return
        self._kept[url] = None
        while len(self._kept) > KEPT_VIDEOS:
            self._kept.popitem(last=False)

    async def _api(self, method: str, path: str, body: State | None) -> State:
        """An answer of the API; asked again until there is one, where evaluators are patient."""
        pause_s = AGAIN_S[0]
        while True:
            said = await self._asked(method, path, body)
            if said is not None:
                return said
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, AGAIN_S[1])

    async def _asked(self, method: str, path: str, body: State | None) -> State | None:
        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        if path.endswith("/sessions"):
            headers = {}
        try:
            async with self._http.request(method, path, json=body, headers=headers) as answer:
                self._count(answer.status)
                if answer.ok:
                    said: State = await answer.json()
                    return said
                text = await answer.text()
        except (aiohttp.ClientError, TimeoutError) as error:
            self._count(0)
            text = f"{type(error).__name__} {error}"
            if self._habits.patient:
                return None
        else:
            # A server that says that it cannot just now will be asked again; any other fault of its
            # own is one.
            if self._habits.patient and answer.status == 503:
                return None
        self._log.fault(f"{method} {path}: {text}")
        raise RefusedError(f"{method} {path}: {text}")

    def _count(self, status: int) -> None:
        self._log.statuses[status] = self._log.statuses.get(status, 0) + 1


class RefusedError(Exception):
    """An answer that an evaluator cannot go on with."""


@asynccontextmanager
async def crowd(
    url: str, slug: str, evaluators: int, habits: Habits, log: Log, seed: int, *, arrive_s: float
) -> AsyncIterator[None]:
    """So many evaluators, arriving one after the other within `arrive_s`, until this is left."""

    async def one(number: int) -> None:
        await asyncio.sleep(arrive_s * number / evaluators)
        async with Evaluator(url, slug, habits, log, seed * 1_000_003 + number) as evaluator:
            while True:
                try:
                    await evaluator.take_part()
                except RefusedError:
                    await asyncio.sleep(1)

    async with asyncio.TaskGroup() as together:
        people = [together.create_task(one(number)) for number in range(evaluators)]
        await asyncio.sleep(arrive_s)
        yield
        for person in people:
            person.cancel()
