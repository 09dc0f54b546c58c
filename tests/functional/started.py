"""A process of our own, begun as people begin it, and ended in every way that there is."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.forked import Process

#: How long a start or an end may take before a test gives up, in seconds.
PATIENCE_S = 60


class Started:
    """A process whose words go into a file; ready once `is_ready` finds so in them."""

    def __init__(self, words: Sequence[str], log: Path, **environment: str) -> None:
        self._output = log
        self._process = self._begun(words, {**os.environ, **environment}, log)
        self._wait_until_ready()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill()

    def _begun(self, words: Sequence[str], environment: Mapping[str, str], log: Path) -> Process:
        with log.open("w") as output:
            return subprocess.Popen(
                words,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                # As a terminal would: tests that run in the background were told to ignore Ctrl+C,
                # and whoever they start would be too.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
            )

    def is_ready(self) -> bool:
        """Whether its words so far say that it does what it is for."""
        raise NotImplementedError

    @property
    def output(self) -> str:
        return self._output.read_text()

    @property
    def pid(self) -> int:
        return self._process.pid

    def kill(self) -> None:
        """End it as a power cut would."""
        self._process.send_signal(signal.SIGKILL)
        self._process.wait(PATIENCE_S)

    def interrupt(self) -> int:
        """End it as Ctrl+C does; the exit status."""
        self._process.send_signal(signal.SIGINT)
        return self._process.wait(PATIENCE_S)

    def terminate(self) -> int:
        """End it as whoever runs servers does; the exit status."""
        self._process.send_signal(signal.SIGTERM)
        return self._process.wait(PATIENCE_S)

    def _wait_until_ready(self) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            if self.is_ready():
                return
            assert self._process.poll() is None, self.output
            time.sleep(0.02)
        self.kill()
        raise AssertionError(f"not ready after {PATIENCE_S} s: {self.output}")
