"""Limits what a connection may send and how long it may take before a request is complete.

The parser keeps a request's first line, its headers and what surrounds a chunked body in memory
until they end, so the application cannot refuse them in time. Proxies have limits of their own;
these are for servers that are reached directly.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

#: Bytes of a request besides its body. The application refuses much less once it has read them.
MOST_BESIDES_BODY = 256_000
#: Bytes around a chunked body for each byte of it: a chunk of one byte takes six.
MOST_AROUND_BODY = 8
#: Seconds from the beginning of a connection or a request to the end of its headers.
HEADERS_WITHIN_S = 60.0


class LimitedHttpProtocol(HttpToolsProtocol):
    """uvicorn's protocol, which closes connections that go beyond these limits."""

    _besides_body = 0
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._expect_headers()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_timer()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self._besides_body += len(data)
        super().data_received(data)
        if self._besides_body > MOST_BESIDES_BODY and not self.transport.is_closing():
            self.transport.close()

    def on_message_begin(self) -> None:
        self._expect_headers()
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        self._stop_timer()
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        self._besides_body = max(0, self._besides_body - (MOST_AROUND_BODY + 1) * len(body))
        super().on_body(body)

    def on_message_complete(self) -> None:
        self._besides_body = 0
        super().on_message_complete()

    def _expect_headers(self) -> None:
        if self._timer is None:
            self._timer = self.loop.call_later(HEADERS_WITHIN_S, self._give_up)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _give_up(self) -> None:
        self._timer = None
        if not self.transport.is_closing():
            self.transport.close()
