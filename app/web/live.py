"""Telling an open page that something has changed: server-sent events.

The database is the truth and is asked about once a second, so that it is all the same which worker
process wrote. A stream ends when its browser leaves, when the server is about to stop, and after a
while by itself: the browser then asks anew, and is checked anew.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Final

from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

SECONDS_BETWEEN_LOOKS: Final = 1.0
#: Proxies close a line on which nothing comes for half a minute or more.
LOOKS_BETWEEN_SIGNS_OF_LIFE: Final = 15
#: Five minutes: after that whoever has lost their rights meanwhile is told nothing more.
LOOKS_PER_STREAM: Final = 300
#: After how long a browser tries again, in milliseconds.
RETRY_MS: Final = 2_000


async def changes(
    read: Callable[[], str],
    known: str | None,
    stopping: Callable[[], bool],
    pause: Callable[[float], Awaitable[None]] = asyncio.sleep,
) -> AsyncIterator[str]:
    """An event for each new stamp that `read`, which may block, comes to; `known` is none."""
    yield f"retry: {RETRY_MS}\n\n"
    for look in range(LOOKS_PER_STREAM):
        if stopping():
            return
        stamp = await run_in_threadpool(read)
        if stamp != known:
            known = stamp
            yield f"id: {stamp}\nevent: changed\ndata: {stamp}\n\n"
        elif look % LOOKS_BETWEEN_SIGNS_OF_LIFE == 0:
            yield ": nothing new\n\n"
        await pause(SECONDS_BETWEEN_LOOKS)


def event_stream(events: AsyncIterator[str]) -> StreamingResponse:
    """The answer that a browser's EventSource reads."""
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(events, media_type="text/event-stream", headers=headers)
