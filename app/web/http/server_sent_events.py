"""Server-sent events that tell an open page when its data has changed.

The database is read once a second, so it does not matter which process wrote. A stream ends when
its browser leaves, when its account has signed out or may no longer see the study, when the server
is about to stop, and after `LOOKS_PER_STREAM`: the browser then reconnects and is checked again.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from datetime import datetime
from functools import partial
from typing import Final

from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from app.services.runtime.errors import TooManyError

from .head_requests import IS_HEAD, headers_alone

SECONDS_BETWEEN_LOOKS: Final = 1.0
#: Proxies close connections that are idle for half a minute or more.
LOOKS_BETWEEN_SIGNS_OF_LIFE: Final = 15
#: Five minutes.
LOOKS_PER_STREAM: Final = 300
#: After how long a browser tries again, in milliseconds.
RETRY_MS: Final = 2_000


#: Streams that one account has open in one process: each asks the database every second.
MOST_STREAMS: Final = 10


class Streams:
    """The streams that are open in this process, by account. Used by the event loop alone."""

    def __init__(self) -> None:
        self._open: Counter[int] = Counter()

    def opened(self, account_id: int, until: datetime) -> Callable[[], None]:
        """Count one more stream; call the returned function when it ends. Raises TooManyError."""
        if self._open[account_id] >= MOST_STREAMS:
            raise TooManyError(
                f"expected at most {MOST_STREAMS} pages of an account that follow a study", until
            )
        self._open[account_id] += 1
        return partial(self._ended, account_id)

    def _ended(self, account_id: int) -> None:
        self._open[account_id] -= 1
        if not self._open[account_id]:
            del self._open[account_id]


async def changes(
    read: Callable[[], str | None],
    known: str | None,
    stopping: Callable[[], bool],
    pause: Callable[[float], Awaitable[None]] = asyncio.sleep,
) -> AsyncIterator[str]:
    """An event for each new change token that `read` returns, which may block.

    known: the token of the page. The events end once `read` returns None.
    """
    yield f"retry: {RETRY_MS}\n\n"
    for look in range(LOOKS_PER_STREAM):
        if stopping():
            return
        stamp = await run_in_threadpool(read)
        if stamp is None:
            return
        if stamp != known:
            known = stamp
            yield f"id: {stamp}\nevent: changed\ndata: {stamp}\n\n"
        elif look % LOOKS_BETWEEN_SIGNS_OF_LIFE == 0:
            yield ": nothing new\n\n"
        await pause(SECONDS_BETWEEN_LOOKS)


class _EventStream(StreamingResponse):
    """The response for a browser's EventSource; `ended` is called when it is over."""

    def __init__(self, events: AsyncIterator[str], ended: Callable[[], None]) -> None:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(events, media_type="text/event-stream", headers=headers)
        self._ended = ended

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            if scope.get(IS_HEAD):
                await headers_alone(self.headers)(scope, receive, send)
            else:
                await super().__call__(scope, receive, send)
        finally:
            self._ended()


def event_stream(events: AsyncIterator[str], ended: Callable[[], None]) -> StreamingResponse:
    """The events as a response. ended: called once the stream is over."""
    return _EventStream(events, ended)
