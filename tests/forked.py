"""Our own program, begun in a fraction of a second.

Loading what it is made of takes seconds, longer than most of what a test looks at. These processes
are forked, each one of its own, from one that has loaded all that and has done nothing else.
"""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import arbitrary_address  # type: ignore[attr-defined]
from multiprocessing.context import ForkServerContext
from pathlib import Path
from subprocess import TimeoutExpired
from typing import Any, Protocol

from app.services.runtime.child_process import child_context

ROOT = Path(__file__).parents[1]

#: What `pbpo serve` loads. None of it begins a thread.
LOADED = ["app.cli", "app.server", "uvicorn.lifespan.on", "uvicorn.protocols.http.httptools_impl"]

#: For processes that are forked from the one that has loaded all that.
CONTEXT = child_context()
assert isinstance(CONTEXT, ForkServerContext)
CONTEXT.set_forkserver_preload(LOADED)


class Process(Protocol):
    """What is asked of a process; `subprocess.Popen` has it."""

    @property
    def pid(self) -> int: ...

    def poll(self) -> int | None: ...

    def send_signal(self, sig: int, /) -> None: ...

    def wait(self, timeout: float | None = None) -> int: ...


class Forked:
    """What `python -m WORDS` is, with the few words of `subprocess.Popen` that tests need.

    environment: all that it finds. log: where it writes.
    """

    def __init__(self, words: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        self._process = CONTEXT.Process(target=_run, args=(list(words), dict(environment), log))
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    def poll(self) -> int | None:
        return self._process.exitcode

    def send_signal(self, number: int, /) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise TimeoutExpired("pbpo", timeout or 0.0)
        return self._process.exitcode


def _run(words: list[str], environment: dict[str, str], log: Path) -> None:
    os.chdir(ROOT)
    os.environ.clear()
    os.environ.update(environment)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    sys.stdin = os.fdopen(0)
    written = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    for stream in (1, 2):
        os.dup2(written, stream)
    os.close(written)
    _fork_a_fork_server()
    sys.argv = words
    import_module(words[0]).main()


def _fork_a_fork_server() -> None:
    """Give this process a fork server of its own, which has loaded all that this one has.

    What `ForkServer.ensure_running` does, without starting another interpreter: its children find
    this process's environment and log.
    """
    server: Any = forkserver._forkserver
    address = arbitrary_address("AF_UNIX")
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(address)
    listener.listen()
    alive_here, alive_there = os.pipe()
    resource_tracker.ensure_running()
    pid = os.fork()
    if pid == 0:
        try:
            os.close(alive_there)
            forkserver.main(listener.fileno(), alive_here, [])
        finally:
            os._exit(0)
    os.close(alive_here)
    listener.close()
    server._forkserver_address = address
    server._forkserver_alive_fd = alive_there
    server._forkserver_pid = pid
