"""The same server, begun in a fraction of a second.

Loading what a server is made of takes seconds, longer than most of what a test looks at. These are
forked, each a process of its own, from one that has loaded all that and has done nothing else.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from subprocess import TimeoutExpired

from .server import ROOT, Server

#: Everything that `pbpo serve` loads; what holds threads is loaded by none of them.
LOADED = ["app.cli", "app.server", "uvicorn.lifespan.on", "uvicorn.protocols.http.httptools_impl"]

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(LOADED)


class ForkedServer(Server):
    """A server as `Server` is, forked. What it wrote is printed when it ends."""

    def _launched(self, words: Sequence[str], environment: Mapping[str, str]) -> _Forked:
        return _Forked(words, environment, self.data_dir.parent / f"server-{self.port}.log")


class _Forked:
    """A forked process with the few words of `subprocess.Popen` that a server needs."""

    def __init__(self, words: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        self._log = log
        self._process: ForkServerProcess = _CONTEXT.Process(
            target=_run, args=(list(words), dict(environment), log)
        )
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    def poll(self) -> int | None:
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise TimeoutExpired("pbpo serve", timeout or 0.0)
        # Into what pytest shows of a test that failed.
        print(self._log.read_text(errors="replace"), file=sys.stderr)
        return self._process.exitcode


def _run(words: list[str], environment: dict[str, str], log: Path) -> None:
    """What `python -m WORDS` does, in a process that has loaded it."""
    os.chdir(ROOT)
    os.environ.clear()
    os.environ.update(environment)
    written = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    for stream in (1, 2):
        os.dup2(written, stream)
    os.close(written)
    sys.argv = words
    import_module(words[0]).main()
