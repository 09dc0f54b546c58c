"""Serving: a socket of our own, so that a taken port is said in a sentence, and uvicorn on it."""

from __future__ import annotations

import gc
import multiprocessing
import os
import resource
import shutil
import signal
import socket as sockets
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI
from prometheus_client.multiprocess import mark_process_dead
from uvicorn.config import LOGGING_CONFIG
from uvicorn.supervisors import Multiprocess

from app.services import jobs
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime import json_logging, metrics
from app.services.runtime.errors import ConflictError
from app.services.runtime.settings import Settings
from app.web.http.connection_limits import LimitedHttpProtocol

from .main import create_app
from .simulation import JOBS

#: How long an idle connection is kept, in seconds.
#: Chromium keeps an idle connection for 300 s, Caddy for 120, nginx for 60.
KEEP_ALIVE_S = 310

#: How long one of this process's threads may compute while others wait, in seconds: Python's own
#: 5 ms add up.
SWITCH_S = 0.001

#: How many newcomers are let in at a turn of the event loop: uvloop takes one from each listening
#: socket, and the turns of a busy server are long.
DOORS = 16

#: New objects after which those that refer to each other in circles are looked for; Python: 700.
GARBAGE_AT = 20_000


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


def doors(socket: sockets.socket) -> list[sockets.socket]:
    """The listening socket, so many times."""
    return [socket, *(socket.dup() for _ in range(DOORS - 1))]


class _Server(uvicorn.Server):
    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready

    async def startup(self, *args: Any, **kwargs: Any) -> None:
        await super().startup(*args, **kwargs)
        if self.started:
            self._ready()


def serve_app(
    app: AppContext, socket: sockets.socket, ready: Callable[[], None], *, json_logs: bool = False
) -> None:
    """Serve until a signal says stop; `ready` is called once requests are answered.

    json_logs: every request and every fault as a line of JSON on standard error; else faults alone,
    for people to read.
    """
    if json_logs:
        json_logging.write_json()
    _expect_many()
    fastapi_app = _application(app)
    config = _config(fastapi_app, app.settings, log_config=None if json_logs else LOGGING_CONFIG)
    server = _Server(config, ready)
    fastapi_app.state.stopping = lambda: server.should_exit
    server.run(sockets=doors(socket))


def serve_with_workers(
    settings: Settings, socket: sockets.socket, workers: int, ready: Callable[[], None]
) -> None:
    """Serve with several processes on one socket; one that dies is replaced. Logs are JSON."""
    json_logging.write_json()
    # Each worker writes its measurements here, and any of them reads them all.
    with tempfile.TemporaryDirectory(prefix="pbpo-workers-") as folder:
        os.environ[metrics.SHARED_DIR] = folder
        config = _config(
            partial(_worker, settings, Path(folder)),
            settings,
            factory=True,
            log_config=None,
            workers=workers,
        )
        # A worker that fits models on a busy machine may be slow to say that it lives.
        config.timeout_worker_healthcheck = 60
        _Workers(config, doors(socket), ready).run()


class _Workers(Multiprocess):
    def __init__(
        self, config: uvicorn.Config, listening: list[sockets.socket], ready: Callable[[], None]
    ) -> None:
        super().__init__(config, listening)
        self._ready = ready

    def init_processes(self) -> None:
        super().init_processes()
        if self.processes[0].wait_until_ready(self.config.timeout_worker_healthcheck):
            self._ready()

    def keep_subprocess_alive(self) -> None:
        before = {process.pid for process in self.processes}
        super().keep_subprocess_alive()
        for pid in before - {process.pid for process in self.processes}:
            # What it had in its queue is in nobody's queue now.
            mark_process_dead(pid)  # type: ignore[no-untyped-call]


def _worker(settings: Settings, folder: Path) -> FastAPI:
    """The application of one worker, made in its own process."""
    json_logging.write_json()
    _expect_many()
    fastapi_app = _application(open_app(settings, job_handlers=JOBS))
    told = threading.Event()

    def tell(before: Any, number: int, frame: FrameType | None) -> None:
        told.set()
        before(number, frame)

    for number in (signal.SIGTERM, signal.SIGINT):
        # The server's own answer is there already, and is given after ours.
        signal.signal(number, partial(tell, signal.getsignal(number)))
    fastapi_app.state.stopping = told.is_set
    threading.Thread(target=partial(_end_with_server, folder), daemon=True).start()
    return fastapi_app


def _end_with_server(folder: Path) -> None:
    """Where the process that all workers began in is killed: they would hold its port for ever."""
    server = multiprocessing.parent_process()
    assert server is not None
    server.join()
    shutil.rmtree(folder, ignore_errors=True)
    os.kill(os.getpid(), signal.SIGTERM)


def _expect_many() -> None:
    """Let many be served at once: by many connections, and none for long."""
    # A thread that holds the database waits for this long for each that computes, at every step.
    sys.setswitchinterval(SWITCH_S)
    # A browser keeps up to six connections, and each is an open file.
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def _application(app: AppContext) -> FastAPI:
    # Closed by the application itself: the server passes a signal on before it returns here.
    fastapi_app = create_app(app=app, closes_studio=True)
    # What is there now stays: looking through it for what can be thrown away, again and again,
    # would take as long as a part of the answers.
    gc.collect()
    gc.freeze()
    gc.set_threshold(GARBAGE_AT)
    jobs.restart_stalled(app)
    return fastapi_app


def _config(fastapi_app: Any, settings: Settings, **more: Any) -> uvicorn.Config:
    return uvicorn.Config(
        fastapi_app,
        http=LimitedHttpProtocol,
        log_level="warning",
        access_log=False,
        # Which software answers is nobody's business.
        server_header=False,
        proxy_headers=bool(settings.trusted_proxies),
        forwarded_allow_ips=settings.trusted_proxies,
        # Longer than browsers and proxies keep a connection that is idle: whoever ends it while the
        # other sends loses a request. They look at a pair for longer than uvicorn's 5 s.
        timeout_keep_alive=KEEP_ALIVE_S,
        # Requests under way are finished; streams end by themselves.
        timeout_graceful_shutdown=10,
        **more,
    )
