"""A real server of its own process, to be killed and started again."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import httpx

from tests.forked import Process
from tests.ports import free_port

#: How long a server may take to answer its first request, on a busy machine.
START_TIMEOUT_S = 60.0


@dataclass
class Server:
    """`pbpo serve` over one data folder, always on the same port.

    more: further words of the command. output: where it may write; where this process does, if
    None. settings: further variables that it finds.
    """

    data_dir: Path
    media_dir: Path
    more: tuple[str, ...] = ()
    database_url: str = ""
    output: IO[bytes] | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    #: How far its clock is before the machine's, in hours.
    clock_ahead_h: float = 0.0
    port: int = field(default_factory=free_port)
    process: Process | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def start(self) -> None:
        words = [*self._program(), "serve", "--port", str(self.port), *self.more]
        environment = {
            "PATH": "/usr/bin:/bin",
            "PBPO_DATA_DIR": str(self.data_dir),
            "PBPO_MEDIA_DIR": str(self.media_dir),
            "PBPO_DATABASE_URL": self.database_url,
            **self.settings,
        }
        self.process = self._launched(words, environment)
        deadline = time.monotonic() + START_TIMEOUT_S
        while True:
            try:
                httpx.get(f"{self.url}/sign-in")
                return
            except httpx.TransportError:
                if time.monotonic() > deadline or self.process.poll() is not None:
                    raise
                time.sleep(0.05)

    def _launched(self, words: Sequence[str], environment: Mapping[str, str]) -> Process:
        """A process that runs these words: a module, and what it is told."""
        return subprocess.Popen(
            [sys.executable, "-m", *words],
            env=environment,
            stdout=self.output,
            stderr=self.output,
            cwd=Path(__file__).parents[2],
        )

    def _program(self) -> list[str]:
        if not self.clock_ahead_h:
            return ["app.cli"]
        return ["tests.browser.another_time", str(self.clock_ahead_h)]

    def kill(self) -> None:
        """As a power cut would: no warning, no last words."""
        self._end(signal.SIGKILL)

    def let_write(self, *, most_bytes: int = resource.RLIM_INFINITY) -> None:
        """How long the files may become that it writes: the kernel refuses what is beyond."""
        assert self.process is not None
        limits = (most_bytes, resource.RLIM_INFINITY)
        resource.prlimit(self.process.pid, resource.RLIMIT_FSIZE, limits)

    def stop(self) -> None:
        self._end(signal.SIGTERM)

    def _end(self, how: signal.Signals) -> None:
        if self.process is not None:
            self.process.send_signal(how)
            self.process.wait(timeout=30)
            self.process = None
