"""A client of the application in the same process, and a session's steps in few words."""

from __future__ import annotations

import asyncio
from types import TracebackType
from typing import Any, Self

import httpx
from fastapi import FastAPI


class Api:
    """Blocking calls to the application: an httpx client whose loop runs one call at a time."""

    def __init__(self, application: FastAPI, **options: Any) -> None:
        self._loop = asyncio.new_event_loop()
        self._client = httpx.AsyncClient(
            transport=httpx.ASGITransport(application), base_url="http://testserver", **options
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

    def run(self, coroutine_of: Any) -> Any:
        """Run a coroutine function of an httpx client, such as a simulated evaluator's walk."""
        return self._loop.run_until_complete(coroutine_of(self._client))

    def start(self, slug: str = "short", **body: Any) -> Session:
        response = self.post(f"/api/v1/studies/{slug}/sessions", json=body)
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
        self.consent()
        while self.state["stage"] != "query":
            assert self.go_on().status_code == 200
        return self
