"""How many evaluators one server holds: `make load`.

A crowd over HTTP does what the pages' scripts do, videos included, on `pbpo serve` over the shipped
study; afterwards every acknowledged response is looked for in the database. The crowd runs on the
same machine and takes processor time too: the table says how much.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from app.services.runtime.settings import Settings
from tests.browser.server import Server
from tests.databases import PostgresServer

from . import stored
from .crowd import Habits, Log, crowd
from .study import STUDY, make_videos, open_shipped

#: Within which a next query should come, in 95 of 100 cases, in milliseconds.
AIM_MS = 100.0
#: The part of the responses that people would give, which a server has to keep up with.
LEAST_SERVED = 0.9
#: For whom the last line says what they would need.
MANY = 10_000


@dataclass(frozen=True)
class Cost:
    """What a run took: processors busy with the server, the database and the crowd; memory."""

    server_cpu: float
    database_cpu: float
    crowd_cpu: float
    memory_mb: float


@dataclass(frozen=True)
class Seen:
    """One run: responses in a second, megabytes of video in all, and what it took."""

    rate: float
    video_mb: float
    cost: Cost


def main() -> None:
    options = _options()
    sound = True
    seen = []
    print(HEAD, flush=True)
    for evaluators in options.evaluators:
        with tempfile.TemporaryDirectory(prefix="pbpo-load-") as folder:
            log, cost, faults = _run(Path(folder), evaluators, options)
        print(_row(evaluators, options, log, cost), flush=True)
        for fault in faults:
            print(f"  fault: {fault}")
        sound &= not faults
        rate = len(log.answer_s) / options.seconds
        # Where people have to wait for each other, more of them say nothing of what one takes.
        if rate > LEAST_SERVED * evaluators / options.think_s:
            seen.append(Seen(rate, log.video_bytes / 1e6, cost))
    if len(seen) > 1:
        print(_foretold(seen, options))
    sys.exit(0 if sound else 1)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--evaluators", type=int, nargs="+", default=[50])
    parser.add_argument("--seconds", type=float, default=60.0, help="measured, after all have come")
    parser.add_argument("--arrive-s", type=float, default=30.0, help="within which all come")
    parser.add_argument("--think-s", type=float, default=12.0, help="mean time for a pair")
    parser.add_argument("--postgresql", action="store_true", help="rather than SQLite")
    parser.add_argument("--workers", type=int, default=1, help="processes that serve")
    parser.add_argument("--media-dir", type=Path, default=Path("build/load-media"))
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


@contextmanager
def database(folder: Path, *, postgresql: bool) -> Iterator[tuple[str, PostgresServer | None]]:
    """The URL of an empty database that loses nothing at a power cut, and its server."""
    if not postgresql:
        yield "", None
        return
    # A socket's path may not be longer than some 100 bytes.
    server = PostgresServer(folder, quickly=False)
    try:
        yield server.new(folder), server
    finally:
        server.close()


def _run(folder: Path, evaluators: int, options: argparse.Namespace) -> tuple[Log, Cost, list[str]]:
    make_videos(options.media_dir.resolve())
    with database(folder, postgresql=options.postgresql) as (url, postgres):
        settings = Settings(
            data_dir=folder / "data", media_dir=options.media_dir.resolve(), database_url=url
        )
        open_shipped(settings, folder)
        more = ("--workers", str(options.workers)) if options.workers > 1 else ()
        with (folder / "server.log").open("wb") as log_file:
            server = Server(settings.data_dir, settings.media_dir, more, url, log_file)
            server.start()
            try:
                log, cost = _measure(server, postgres, evaluators, options)
            finally:
                server.stop()
        lost = stored.faults(settings, STUDY, log, log.in_hand)
        errors = stored.errors_in(folder / "server.log")
    return log, cost, [*lost, *log.faults[:5], *errors[:2]]


def _measure(
    server: Server, postgres: PostgresServer | None, evaluators: int, options: argparse.Namespace
) -> tuple[Log, Cost]:
    assert server.process is not None
    processes = [_Tree(server.process.pid), _Tree(psutil.Process().pid, alone=True)]
    if postgres is not None:
        processes.append(_Tree(postgres.pid))
    # The crowd's own pauses must not look like the server's.
    gc.freeze()
    log = Log()

    async def run() -> None:
        habits = Habits(think_s=options.think_s)
        async with crowd(
            server.url,
            STUDY,
            evaluators,
            habits,
            log,
            options.seed,
            arrive_s=options.arrive_s,
        ):
            # What was before the last of them came does not count.
            log.begin()
            for one in processes:
                one.begin()
            await asyncio.sleep(options.seconds)
            spent.extend(one.spent() / options.seconds for one in processes)

    spent: list[float] = []
    asyncio.run(run())
    served, people, *rows = spent
    return log, Cost(served, sum(rows), people, processes[0].memory_mb())


class _Tree:
    """A process and those that it started."""

    def __init__(self, pid: int, *, alone: bool = False) -> None:
        self._root = psutil.Process(pid)
        self._alone = alone
        self._before = 0.0

    def begin(self) -> None:
        self._before = self._now()

    def spent(self) -> float:
        """Processor time since the beginning, in seconds."""
        return self._now() - self._before

    def memory_mb(self) -> float:
        """What is theirs alone, shared pages counted once in parts."""
        return float(sum(one.memory_full_info().pss for one in self._all())) / 1e6

    def _now(self) -> float:
        times = [one.cpu_times() for one in self._all()]
        # Of those that ended meanwhile the parent keeps the account.
        return float(
            sum(one.user + one.system + one.children_user + one.children_system for one in times)
        )

    def _all(self) -> list[psutil.Process]:
        return [self._root, *([] if self._alone else self._root.children(recursive=True))]


HEAD = (
    "| evaluators | on | responses/s | next query median | p95 | p99 | longest | video p95 "
    "| MB/s | server CPU | database CPU | crowd CPU | memory | errors |\n" + "|---" * 14 + "|"
)


def _row(evaluators: int, options: argparse.Namespace, log: Log, cost: Cost) -> str:
    answers = 1000 * np.asarray(log.answer_s or [np.nan])
    median, p95, p99 = np.percentile(answers, [50, 95, 99])
    video = 1000 * np.percentile(log.video_s, 95) if log.video_s else float("nan")
    errors = sum(count for status, count in log.statuses.items() if not 200 <= status < 400)
    on = f"PostgreSQL, {options.workers}" if options.postgresql else "SQLite, 1"
    cells = [
        str(evaluators),
        on,
        f"{len(log.answer_s) / options.seconds:.1f}",
        f"{median:.0f} ms",
        f"{p95:.0f} ms{'' if p95 <= AIM_MS else ' (missed)'}",
        f"{p99:.0f} ms",
        f"{answers.max():.0f} ms",
        f"{video:.0f} ms",
        f"{log.video_bytes / 1e6 / options.seconds:.1f}",
        f"{cost.server_cpu:.2f}",
        f"{cost.database_cpu:.2f}" if options.postgresql else "",
        f"{cost.crowd_cpu:.2f}",
        f"{cost.memory_mb:.0f} MB",
        f"{errors}",
    ]
    return f"| {' | '.join(cells)} |"


def _foretold(seen: list[Seen], options: argparse.Namespace) -> str:
    """What so many would need: a line fitted to the runs, cost against responses in a second."""
    rates = np.array([run.rate for run in seen])

    def per_response(values: list[float]) -> float:
        return float(np.polyfit(rates, values, 1)[0])

    server = per_response([run.cost.server_cpu for run in seen])
    database = per_response([run.cost.database_cpu for run in seen])
    video = per_response([run.video_mb / options.seconds for run in seen])
    rate = MANY / options.think_s
    return (
        f"A response takes {1000 * server:.0f} ms of the server's processors"
        f" and {1000 * database:.1f} ms of the database's, and {video:.2f} MB of video.\n"
        f"{MANY:,} evaluators who think for {options.think_s:g} s: {rate:.0f} responses/s,"
        f" {rate * server:.0f} processors that serve, {rate * database:.0f} for the database,"
        f" {8 * rate * video / 1000:.1f} Gbit/s of video."
    )


if __name__ == "__main__":
    main()
