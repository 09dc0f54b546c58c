"""What is broken under a crowd: the server, its database, its machines, and what the crowd saw."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from signal import Signals

import numpy as np
import psutil

from app.services.runtime.settings import Settings
from tests.browser.forked import ForkedServer
from tests.browser.server import Server
from tests.databases import PostgresServer
from tests.forked import CONTEXT, LOADED

from .crowd import Log
from .fleet import Fleet

#: How long a killed server's workers may take to end by themselves, in seconds.
END_S = 30


class QuickServer(ForkedServer):
    """A server that is there again within a second of its death."""

    @property
    def log(self) -> Path:
        """What it has written, in all its lives."""
        return self._log

    def start(self) -> None:
        # What all its lives are forked from loads the program first, however long that takes, and
        # what began this test, which each of them would load otherwise.
        CONTEXT.set_forkserver_preload([*LOADED, "app.main", "tests.load.measure"])
        first = CONTEXT.Process(target=int)
        first.start()
        first.join()
        super().start()

    def _end(self, how: Signals) -> None:
        Server._end(self, how)


@dataclass(frozen=True)
class Scene:
    """What there is to break."""

    server: Server
    settings: Settings
    postgres: PostgresServer | None
    rng: np.random.Generator
    log: Log
    times: int
    machines: Fleet | None = None

    async def answers(self, number: int = 5) -> None:
        """Wait until the crowd got so many more answers: the studio works."""
        wanted = self.answered + number
        while self.answered < wanted:
            await asyncio.sleep(0.02)

    async def somebody_rests(self) -> None:
        """Wait until somebody is in a break."""
        while not self.log.resting:
            await asyncio.sleep(0.02)

    @property
    def answered(self) -> int:
        return sum(map(len, self.log.acknowledged.values()))

    def kill(self, *, everybody: bool) -> None:
        """Kill the server; of several processes the one that began the others, or all at once."""
        workers: list[psutil.Process] = []
        if self.server.more and self.server.process is not None:
            children = psutil.Process(self.server.process.pid).children()
            workers = [one for one in children if "spawn_main" in " ".join(one.cmdline())]
        self.server.kill()
        for worker in workers if everybody else ():
            with suppress(psutil.NoSuchProcess):
                worker.kill()
        # Those that go on would keep the server's port.
        _, left = psutil.wait_procs(workers, timeout=END_S)
        for worker in left:
            worker.kill()
        if left:
            self.log.fault(f"{len(left)} workers outlived their server by {END_S} s")


async def started(server: Server) -> None:
    """Start the server, which takes a while."""
    await asyncio.to_thread(server.start)
