"""A server of our own in a process of its own, as people start it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Self

PBPO = Path(sys.executable).with_name("pbpo")

#: How long a start or an end may take before a test gives up, in seconds.
PATIENCE_S = 60


class Served:
    """`pbpo serve` or `pbpo demo` on a free port. `url` is where it answers."""

    def __init__(self, command: str, data_dir: Path, media_dir: Path, *more: str) -> None:
        self._output = data_dir.parent / f"{command}.log"
        environment = {**os.environ, "PBPO_MEDIA_DIR": str(media_dir)}
        words = [str(PBPO), command, "--port", "0", "--data-dir", str(data_dir), *more]
        with self._output.open("w") as output:
            self._process = subprocess.Popen(
                words,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                # As a terminal would: tests that run in the background were told to ignore Ctrl+C,
                # and whoever they start would be too.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
            )
        self.url = self._first_address()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill()

    @property
    def output(self) -> str:
        return self._output.read_text()

    def kill(self) -> None:
        """End it as a power cut would."""
        self._process.kill()
        self._process.wait(PATIENCE_S)

    def interrupt(self) -> int:
        """End it as Ctrl+C does; the exit status."""
        self._process.send_signal(signal.SIGINT)
        return self._process.wait(PATIENCE_S)

    def terminate(self) -> int:
        """End it as whoever runs servers does; the exit status."""
        self._process.send_signal(signal.SIGTERM)
        return self._process.wait(PATIENCE_S)

    @property
    def pid(self) -> int:
        return self._process.pid

    def _first_address(self) -> str:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            if found := re.search(r"http://127\.0\.0\.1:\d+", self.output):
                return found[0]
            assert self._process.poll() is None, self.output
            time.sleep(0.02)
        self.kill()
        raise AssertionError(f"no address after {PATIENCE_S} s: {self.output}")
