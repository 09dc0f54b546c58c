"""A worker of our own in a process of its own, which is given up sooner than a real one."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

from app.services.maintenance.worker_tasks import HeartbeatConfig
from app.services.runtime.settings import Settings

from .started import Started

#: What a worker does gives way to everything else, and a machine may be busy: in seconds.
PATIENCE_S = 120

#: A real worker is given up after 8 s: tests have no time for that.
QUICK = HeartbeatConfig(beat_s=0.2, gone_after_s=1.5, job_lost_after_s=1.5)

_CODE = """
from app.services.runtime.settings import Settings
from app.services.maintenance.worker_tasks import HeartbeatConfig
from app.worker import work
if __name__ == "__main__":
    work(Settings({named}), 1, lambda: print("ready", flush=True), heartbeat={heartbeat})
"""


class Worker(Started):
    """A worker that makes one video at a time, ready when this returns."""

    def __init__(self, settings: Settings, folder: Path) -> None:
        named = settings.model_dump(mode="json", exclude_unset=True, exclude={"metrics_token"})
        named["workers_apart"] = True
        # Its processes import it again: it has to be a file.
        script = folder / f"worker_{time.monotonic_ns()}.py"
        script.write_text(_CODE.format(named=f"**{named}", heartbeat=QUICK))
        root = str(Path(__file__).parents[2])
        super().__init__([sys.executable, str(script)], script.with_suffix(".log"), PYTHONPATH=root)

    def is_ready(self) -> bool:
        return "ready" in self.output


def until(condition: Callable[[], bool], what: str, worker: Worker | None = None) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"{what}: {worker.output if worker else ''}"
        time.sleep(0.02)
