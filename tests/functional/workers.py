"""A worker of our own in a process of its own, which is given up sooner than a real one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from app.services.settings import Settings
from app.services.worker_tasks import Pulse

#: A real worker is given up after 8 s: tests have no time for that.
QUICK = Pulse(beat_s=0.2, gone_after_s=1.5, job_lost_after_s=1.5)

_CODE = """
from app.services.settings import Settings
from app.services.worker_tasks import Pulse
from app.worker import work
if __name__ == "__main__":
    work(Settings({named}), 1, lambda: print("ready", flush=True), pulse={pulse})
"""


class Worker:
    """A worker that makes one video at a time, ready when this returns."""

    def __init__(self, settings: Settings, folder: Path) -> None:
        named = {
            "database_url": settings.database_url,
            "data_dir": str(settings.data_dir),
            "media_dir": str(settings.media_dir),
            "workers_apart": True,
        }
        self._output = folder / f"worker-{time.monotonic_ns()}.log"
        # Its processes import it again: it has to be a file.
        script = self._output.with_suffix(".py")
        script.write_text(_CODE.format(named=f"**{named}", pulse=QUICK))
        with self._output.open("w") as output:
            self._process = subprocess.Popen(
                [sys.executable, str(script)],
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
            )
        until(lambda: "ready" in self.output, "the worker is ready", self)

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
        self._process.wait(60)

    def terminate(self) -> int:
        """End it as whoever runs workers does; the exit status."""
        self._process.send_signal(signal.SIGTERM)
        return self._process.wait(60)


def until(condition: Callable[[], bool], what: str, worker: Worker | None = None) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline, f"{what}: {worker.output if worker else ''}"
        time.sleep(0.02)
