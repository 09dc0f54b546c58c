"""A client of the application in the same process, and a session's steps in few words."""

from __future__ import annotations

import asyncio
import io
from collections.abc import Callable
from dataclasses import dataclass
from itertools import cycle
from types import TracebackType
from typing import Any, Self

import httpx
import pandas as pd
from fastapi import FastAPI

#: What tests let pass before each response.
SECONDS_PER_QUERY = 12


@dataclass(frozen=True)
class Pressed:
    """What an evaluator pressed, and where they were told to be."""

    trial: int
    query: int
    response: str
    rt_ms: float


class Api:
    """Blocking calls to the application: an httpx client whose loop runs one call at a time."""

    def __init__(self, application: FastAPI, **options: Any) -> None:
        self._loop = asyncio.new_event_loop()
        self._client = httpx.AsyncClient(
            transport=httpx.ASGITransport(application),
            **{"base_url": "http://testserver", **options},
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._loop.run_until_complete(self._client.aclose())
        self._loop.close()

    @property
    def cookies(self) -> httpx.Cookies:
        return self._client.cookies

    def request(self, method: str, path: str, **options: Any) -> httpx.Response:
        return self._loop.run_until_complete(self._client.request(method, path, **options))

    def get(self, path: str, **options: Any) -> httpx.Response:
        return self.request("GET", path, **options)

    def post(self, path: str, **options: Any) -> httpx.Response:
        return self.request("POST", path, **options)

    def table(self, name: str, api_token: str, *modes: str) -> pd.DataFrame:
        """An exported table, as an experimenter reads it."""
        response = self.get(
            f"/api/v1/studies/short/export/{name}.csv",
            params=[("mode", mode) for mode in modes],
            headers={"Authorization": f"Bearer {api_token}"},
        )
        assert response.status_code == 200, response.text
        return pd.read_csv(io.BytesIO(response.content))

    def run(self, coroutine_of: Any) -> Any:
        """Run a coroutine function of an httpx client, such as a simulated evaluator's walk."""
        return self._loop.run_until_complete(coroutine_of(self._client))

    def start(self, slug: str = "short", *, by: str = "", **body: Any) -> Session:
        """Begin a session. by: an experimenter's API token, where one is wanted."""
        headers = {"Authorization": f"Bearer {by}"} if by else {}
        response = self.post(f"/api/v1/studies/{slug}/sessions", json=body, headers=headers)
        assert response.status_code == 201, response.text
        answer = response.json()
        return Session(self, answer["token"], answer["session"])


class Session:
    """One session's calls, with its token. `state` is what the server last said."""

    def __init__(self, api: Api, token: str, state: dict[str, Any]) -> None:
        self.api = api
        self.token = token
        self.state = state

    @property
    def headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.token}"}

    def call(self, step: str, body: Any = None) -> httpx.Response:
        response = self.api.post(f"/api/v1/session/{step}", json=body, headers=self.headers)
        if response.status_code == 200:
            self.state = response.json()
        return response

    def look(self) -> dict[str, Any]:
        response = self.api.get("/api/v1/session", headers=self.headers)
        assert response.status_code == 200, response.text
        self.state = response.json()
        return self.state

    def consent(self) -> httpx.Response:
        return self.call("consent", {"version": self.state["consent"]["version"]})

    def go_on(self) -> httpx.Response:
        return self.call("continue")

    def respond(self, response: str, **more: Any) -> httpx.Response:
        return self.call(
            "responses", {"query_id": self.state["query"]["id"], "response": response, **more}
        )

    def to_first_query(self) -> Session:
        return self.to_stage("query", lambda _: None)

    def to_stage(self, stage: str, wait: Callable[[float], None]) -> Session:
        """Go on to the first time that the session is in this stage."""
        if stage == "declined":
            self.call("withdraw")
        elif stage == "withdrawn":
            self.to_first_query().call("withdraw")
        while self.state["stage"] != stage:
            assert self.step("left", wait).status_code == 200
        return self

    def step(
        self, response: str, wait: Callable[[float], None], rt_ms: float = 1000.0
    ) -> httpx.Response:
        """Do what the stage asks for, as soon as it may be done."""
        match self.state["stage"]:
            case "consent":
                return self.consent()
            case "query" | "practice":
                wait(SECONDS_PER_QUERY)
                return self.respond(response, rt_ms=rt_ms)
            case "break":
                wait(self.state["break"]["seconds_left"])
            case "device_check":
                device = {"width_px": 1920, "played": True, "mbit_s": 1000.0}
                return self.call("continue", {"device": device})
            case "questionnaire":
                asked = self.state["questionnaire"]["items"]
                return self.call("questionnaire", {"answers": {item["name"]: 3 for item in asked}})
        return self.go_on()

    def to_the_end(
        self, choose: Callable[[dict[str, Any]], str], wait: Callable[[float], None]
    ) -> list[Pressed]:
        """Go on until the session is over; what was pressed on the way, in order."""
        pressed: list[Pressed] = []
        while self.state["stage"] not in ("completed", "withdrawn", "declined"):
            response, rt_ms = "", 1000.0 + len(pressed) / 4
            if self.state["stage"] == "query":
                at, response = self.state["progress"], choose(self.state)
                pressed.append(Pressed(at["trial"], at["query"], response, rt_ms))
            elif self.state["stage"] == "practice":
                response = choose(self.state)
            answer = self.step(response, wait, rt_ms)
            assert answer.status_code == 200, answer.text
        return pressed


def by_turns(*responses: str) -> Callable[[dict[str, Any]], str]:
    """Presses these over and over; left in place of a skip where none is offered."""
    turns = cycle(responses)

    def choose(state: dict[str, Any]) -> str:
        response = next(turns)
        offered = response != "skip" or state["query"]["skip"] is not None
        return response if offered else "left"

    return choose
