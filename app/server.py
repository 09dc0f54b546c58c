"""Serving: a socket of our own, so that a taken port is said in a sentence, and uvicorn on it."""

from __future__ import annotations

import socket as sockets
from collections.abc import Callable
from typing import Any

import uvicorn
from uvicorn.config import LOGGING_CONFIG

from app.main import create_app
from app.services import design, jobs, logs
from app.services.errors import ConflictError
from app.services.studio import Studio
from app.simulation import simulate_job


def listen(host: str, port: int) -> sockets.socket:
    """A listening socket; port 0 takes a free one. Raises ConflictError if the port is taken."""
    family = sockets.AF_INET6 if ":" in host else sockets.AF_INET
    socket = sockets.socket(family, sockets.SOCK_STREAM)
    # A server that was just killed leaves its port waiting: a restart need not.
    socket.setsockopt(sockets.SOL_SOCKET, sockets.SO_REUSEADDR, 1)
    try:
        socket.bind((host, port))
        # Bound but not listening, two servers could both begin; the second is told at once.
        socket.listen(2048)
    except OSError as error:
        socket.close()
        raise ConflictError(
            f"expected a free port, and {host}:{port} cannot be had: {error.strerror}"
        ) from None
    return socket


class _Server(uvicorn.Server):
    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready

    async def startup(self, *args: Any, **kwargs: Any) -> None:
        await super().startup(*args, **kwargs)
        if self.started:
            self._ready()


def serve_app(
    studio: Studio, socket: sockets.socket, ready: Callable[[], None], *, json_logs: bool = False
) -> None:
    """Serve until a signal says stop; `ready` is called once requests are answered.

    json_logs: every request and every fault as a line of JSON on standard error; else faults alone,
    for people to read.
    """
    if json_logs:
        logs.write_json()
    # Closed by the application itself: the server passes a signal on before it returns here.
    app = create_app(studio=studio, closes_studio=True)
    # Simulated evaluators walk through the application itself, which services know nothing of.
    studio.works[design.SIMULATE] = simulate_job
    jobs.revive(studio)
    config = uvicorn.Config(
        app,
        log_level="warning",
        log_config=None if json_logs else LOGGING_CONFIG,
        access_log=False,
        timeout_graceful_shutdown=10,
    )
    server = _Server(config, ready)
    app.state.stopping = lambda: server.should_exit
    server.run(sockets=[socket])
