"""Long JSON bodies: parsed in a thread, and only if they hold few objects and lists.

Half a megabyte of brackets is 200,000 lists, which take the interpreter far longer than its text
does, in whatever thread. So brackets are counted before the text is parsed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine
from typing import Any, Final

from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from .body_limit import SMALL

#: Objects and lists in one long body: room for an answer with thousands of events.
MOST_PARTS: Final = 10_000


class _Parsed(Request):
    """A request whose long JSON body is parsed in a thread."""

    async def json(self) -> Any:
        if not hasattr(self, "_json"):
            body = await self.body()
            if len(body) <= SMALL:
                self._json = json.loads(body)
            else:
                parts = body.count(b"[") + body.count(b"{")
                if parts > MOST_PARTS:
                    said = f"Expected at most {MOST_PARTS:,} objects and lists, got {parts:,}"
                    raise HTTPException(400, said)
                self._json = await run_in_threadpool(json.loads, body)
        return self._json


class ThreadParsedJsonRoute(APIRoute):
    """A route whose JSON bodies longer than `SMALL` are parsed in a thread."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler of the route, which reads requests as `_Parsed`."""
        handle = super().get_route_handler()

        async def handled(request: Request) -> Response:
            return await handle(_Parsed(request.scope, request.receive))

        return handled
