"""The server's doors."""

from __future__ import annotations

import asyncio
import socket
from contextlib import ExitStack, closing

import uvloop

from app import server


def test_a_busy_server_lets_in_many_at_a_turn() -> None:
    let_in: list[asyncio.BaseTransport] = []

    class Guest(asyncio.Protocol):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            let_in.append(transport)

    async def three_turns(listening: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        doors = [await loop.create_server(Guest, sock=door) for door in server.doors(listening)]
        with ExitStack() as outside:
            for _ in range(server.DOORS):
                person = socket.create_connection(listening.getsockname())
                outside.enter_context(closing(person))
            for _ in range(3):
                await asyncio.sleep(0)
        for transport in let_in:
            transport.close()
        for door in doors:
            door.close()

    uvloop.run(three_turns(server.listen("127.0.0.1", 0)))
    assert len(let_in) == server.DOORS
