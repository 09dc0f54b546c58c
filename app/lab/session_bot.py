"""A simulated evaluator walks a whole session through the API, as a browser would."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import httpx

from .evaluators import Evaluator

State = dict[str, Any]

#: What a simulated evaluator says that it took to answer, in milliseconds.
RT_MS = 12_000.0
#: Seconds between two looks at a pair that a machine is to record.
LOOK_EVERY_S = 0.25


async def look_again_soon(_waiting: State) -> None:
    """Let machines elsewhere record what a pair waits for."""
    await asyncio.sleep(LOOK_EVERY_S)


async def walk(
    client: httpx.AsyncClient,
    slug: str,
    evaluator_of: Callable[[str], Evaluator],
    score_of: Callable[[str], float],
    *,
    mode: str,
    api_token: str,
    wait: Callable[[float], Awaitable[None]],
    recording: Callable[[State], Awaitable[None]] = look_again_soon,
    began: Callable[[str], None] = lambda _token: None,
    answered: Callable[[], None] = lambda: None,
) -> State:
    """From arrival to completion; the state in the end.

    evaluator_of: who answers a query, of its id. score_of: g of a recording, of its address. wait:
    lets that many seconds pass. recording: called with `waiting` of the state, again and again,
    while a machine has to record the pair. began: told the session's token. Raises
    httpx.HTTPStatusError for any answer that is not a success.
    """
    started = await _call(
        client, "POST", f"/api/v1/studies/{slug}/sessions", api_token, {"mode": mode}
    )
    token, state = started["token"], started["session"]
    began(token)
    while state["stage"] not in ("completed", "withdrawn", "declined"):
        if state["stage"] == "query" and state["query"] is None:
            await recording(state["waiting"])
            state = await _call(client, "GET", "/api/v1/session", token, None)
            continue
        match state["stage"]:
            case "consent":
                body: State | None = {"version": state["consent"]["version"]}
                path = "consent"
            case "query" | "practice":
                query = state["query"]
                left, right = (score_of(query[side]["url"]) for side in ("left", "right"))
                evaluator = evaluator_of(query["id"])
                response = evaluator.respond(left, right, may_skip=query["skip"] is not None)
                body = {"query_id": query["id"], "response": response, "rt_ms": RT_MS}
                path = "responses"
                await wait(RT_MS / 1000)
                answered()
            case "break":
                await wait(state["break"]["seconds_left"])
                body, path = None, "continue"
            case "familiarisation":
                for index in range(state["familiarisation"]["required"]):
                    seen: State = {"index": index}
                    await _call(client, "POST", "/api/v1/session/watched", token, seen)
                body, path = None, "continue"
            case "device_check":
                # A simulated evaluator has whatever device it takes.
                device = {"width_px": 1920, "played": True, "mbit_s": 1000.0}
                body, path = {"device": device}, "continue"
            case "questionnaire":
                asked = state["questionnaire"]["items"]
                body = {"answers": {item["name"]: _answer(item) for item in asked}}
                path = "questionnaire"
            case _:
                body, path = None, "continue"
        state = await _call(client, "POST", f"/api/v1/session/{path}", token, body)
    final: State = state
    return final


def _answer(item: State) -> str | float | None:
    """The least that an item takes: a simulated evaluator has no opinions of its own."""
    if not item["required"]:
        return None
    if item["type"] == "text":
        return "simulated"
    if item["type"] == "choice":
        return str(item["choices"][0]["name"])
    if item["type"] == "likert":
        return int(item["points"]) // 2 + 1
    ends = [end for end in (item["min"], item["max"]) if end is not None]
    return float(ends[0]) if ends else 0.0


async def _call(
    client: httpx.AsyncClient, method: str, path: str, token: str, body: State | None
) -> State:
    response = await client.request(
        method, path, json=body, headers={"Authorization": f"Bearer {token}"}
    )
    response.raise_for_status()
    answer: State = response.json()
    return answer
