"""What evaluators live through when things break: `make chaos`.

A crowd that presses quickly works on `pbpo serve`, and something is broken under it, again and
again; in one scene machines record what it chooses among, and are killed as well. Whatever was
acknowledged has to be stored, once; each session goes on at its own query; and every query has to
be the one that its history says. The crowd sends again what got no answer, or 503, as the pages do;
any other fault of the server's, also one that only its log tells, is one.
"""

from __future__ import annotations

import argparse
import asyncio
import sqlite3
import sys
import tempfile
from collections.abc import Awaitable, Callable, Mapping
from contextlib import closing
from pathlib import Path

import httpx
import numpy as np

from app.services.runtime.settings import Settings
from tests.browser.server import Server

from . import fleet, stored
from .crowd import Habits, Log, crowd
from .fleet import Fleet, open_machine_study
from .measure import database
from .scene import QuickServer, Scene, started
from .study import STUDY, make_videos, open_shipped

#: Evaluators in the crowd, and the mean time that they look at a pair, in seconds.
CROWD, THINK_S = 12, 0.4

#: How the shipped study is changed: people soon come to a break, which is over soon.
STUDY_SO = {"queries_per_trial": 10, "break_s": 3}

#: In the scene with machines: evaluators, machines, seconds that a run takes, and how rollouts are
#: asked for. A machine that dies is missed soon, and no rollout runs out of attempts.
FEW, MACHINES, RUN_S = 8, 4, 0.5
ROLLOUTS = "{timeout_s: 15, attempts: 20}"

Break = Callable[[Scene], Awaitable[None]]


async def killed(scene: Scene) -> None:
    """SIGKILL at a random moment; of several processes, in turn, the first alone or all."""
    for time in range(scene.times):
        await scene.answers()
        await asyncio.sleep(scene.rng.uniform(0, 0.5))
        await asyncio.to_thread(scene.kill, everybody=time % 2 == 1)
        await started(scene.server)


async def ended(scene: Scene) -> None:
    """SIGTERM at a random moment: what is under way is finished."""
    for _ in range(max(scene.times // 5, 1)):
        await scene.answers()
        await asyncio.sleep(scene.rng.uniform(0, 0.5))
        await asyncio.to_thread(scene.server.stop)
        await started(scene.server)


async def database_stopped(scene: Scene) -> None:
    """PostgreSQL is stopped for some seconds, with every connection cut, and started again."""
    assert scene.postgres is not None
    for _ in range(max(scene.times // 20, 1)):
        await scene.answers()
        await asyncio.to_thread(scene.postgres.stop)
        await asyncio.sleep(3)
        await asyncio.to_thread(scene.postgres.start)
    await scene.answers()


async def database_silent(scene: Scene) -> None:
    """PostgreSQL says nothing for 20 s. The server waits for it, and for nothing else."""
    assert scene.postgres is not None
    for _ in range(max(scene.times // 20, 1)):
        await scene.answers()
        with scene.postgres.silent():
            await asyncio.sleep(5)
            for _ in range(5):
                async with httpx.AsyncClient(base_url=scene.server.url, timeout=2) as client:
                    (await client.get("/healthz")).raise_for_status()
                await asyncio.sleep(3)
        await scene.answers()


async def disk_full(scene: Scene) -> None:
    """No file of the server's may grow for some seconds."""
    for _ in range(max(scene.times // 20, 1)):
        await scene.answers()
        scene.server.let_write(most_bytes=0)
        await asyncio.sleep(3)
        scene.server.let_write()
    await scene.answers()


async def locked(scene: Scene) -> None:
    """Somebody else keeps the database's lock for 30 s: twice as long as the server waits."""
    await scene.answers()
    path = scene.settings.data_dir / "pbpo.sqlite3"
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        await asyncio.sleep(30)
        other.execute("ROLLBACK")
    await scene.answers()


async def videos_gone(scene: Scene) -> None:
    """The folder of videos is away for some seconds."""
    media, away = scene.settings.media_dir, scene.settings.media_dir.with_name("away")
    await scene.answers()
    media.rename(away)
    await asyncio.sleep(5)
    # What was made again meanwhile is the same as what comes back.
    if media.exists():
        for made in media.iterdir():
            made.replace(away / made.name)
        media.rmdir()
    away.rename(media)
    await scene.answers()
    before = scene.log.videos
    while scene.log.videos < before + 5:
        await asyncio.sleep(0.05)


async def clock_back(scene: Scene) -> None:
    """The server's clock goes back by two hours, and after some answers to where it was.

    Somebody is in a break each time: nobody is to stay there until the clock comes round again.
    """
    await scene.answers()
    for hours in (-2.0, 0.0):
        await scene.somebody_rests()
        await asyncio.to_thread(scene.server.stop)
        scene.server.clock_ahead_h = hours
        await started(scene.server)
        await scene.answers(3 * CROWD)


async def machines_killed(scene: Scene) -> None:
    """SIGKILL of a machine, and of the server every third time; uploads are cut in two."""
    machines = scene.machines
    assert machines is not None
    with fleet.working(machines):
        for time in range(scene.times):
            await scene.answers(2)
            await asyncio.sleep(scene.rng.uniform(0, 0.5))
            if time % 3 == 2:
                await asyncio.to_thread(scene.kill, everybody=True)
                await started(scene.server)
            else:
                victim = int(scene.rng.integers(MACHINES))
                await asyncio.to_thread(machines.kill, victim)
                machines.begin(victim)
        await scene.answers()


SQLITE: tuple[Break, ...] = (
    *(killed, ended, disk_full, locked, videos_gone, clock_back, machines_killed),
)
POSTGRESQL: tuple[Break, ...] = (killed, ended, database_stopped, database_silent, machines_killed)
NAMES = [breaking.__name__ for breaking in {*SQLITE, *POSTGRESQL}]

#: Errors that the log is to tell of, by what was broken: how their messages begin.
_NO_DATABASE = ("the database failed", "the database was lost", "faults could not be counted now")
#: A connection was left in the middle of a statement: its pool throws it away, and says so.
_LEFT = ("Exception during reset", "Exception terminating connection")
EXPLAINED: Mapping[Break, tuple[str, ...]] = {
    disk_full: _NO_DATABASE,
    locked: _NO_DATABASE,
    database_stopped: (*_NO_DATABASE, *_LEFT),
    database_silent: (*_NO_DATABASE, *_LEFT),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=100, help="how often the server is killed")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", choices=NAMES, help="names of what is broken")
    parser.add_argument(
        "--on", choices=["sqlite", "postgresql"], help="default: one after the other"
    )
    parser.add_argument(
        "--workers", type=int, default=1, help="processes that serve; several on PostgreSQL alone"
    )
    parser.add_argument("--media-dir", type=Path, default=Path("build/load-media"))
    options = parser.parse_args()
    print("| broken | on | times asked again | refused | answers acknowledged | lost or doubled |")
    print("|---|---|---|---|---|---|", flush=True)
    sound = True
    wanted = "postgresql" if options.workers > 1 else options.on
    for on, breaks in (("sqlite", SQLITE), ("postgresql", POSTGRESQL)):
        for breaking in breaks:
            if wanted in (None, on) and breaking.__name__ in (options.only or NAMES):
                sound &= _play(breaking, options, postgresql=on == "postgresql")
    sys.exit(0 if sound else 1)


def _play(breaking: Break, options: argparse.Namespace, *, postgresql: bool) -> bool:
    source = options.media_dir.resolve()
    if breaking is not machines_killed:
        make_videos(source)
    with (
        tempfile.TemporaryDirectory(prefix="pbpo-chaos-") as name,
        database(Path(name), postgresql=postgresql) as (url, postgres),
    ):
        folder = Path(name)
        media = folder / "media"
        media.mkdir()
        for video in source.glob("*.mp4"):
            (media / video.name).symlink_to(video)
        settings = Settings(data_dir=folder / "data", media_dir=media, database_url=url)
        tokens: list[str] = []
        has_machines = breaking is machines_killed
        if has_machines:
            tokens = open_machine_study(settings, folder, MACHINES, rollout=ROLLOUTS)
        else:
            open_shipped(settings, folder, **STUDY_SO)
        more = ("--workers", str(options.workers)) if options.workers > 1 else ()
        said = folder / "server.log"
        with said.open("wb") as output:
            # Where machines are killed the server soon has to be there again: it is forked.
            kind = QuickServer if has_machines else Server
            server = kind(settings.data_dir, media, more, url, output)
            server.start()
            rng = np.random.default_rng(options.seed)
            machines = Fleet(server.url, tokens, folder, RUN_S) if has_machines else None
            scene = Scene(server, settings, postgres, rng, Log(), options.times, machines)
            try:
                asyncio.run(_break(scene, breaking))
            finally:
                scene.kill(everybody=True)
        if isinstance(server, QuickServer):
            said = server.log
        errors = stored.errors_in(said, EXPLAINED.get(breaking, ()))
        slug = fleet.STUDY if has_machines else STUDY
        notes = machines.notes() if machines is not None else []
        lost = stored.faults(settings, slug, scene.log, scene.log.in_hand, notes)
    log = scene.log
    again = log.statuses.get(0, 0)
    refused = {status: count for status, count in sorted(log.statuses.items()) if status >= 400}
    cells = [
        f"{breaking.__name__.replace('_', ' ')}",
        f"PostgreSQL, {options.workers}" if postgresql else "SQLite, 1",
        f"{again}",
        ", ".join(f"{count} x {status}" for status, count in refused.items()) or "none",
        f"{scene.answered}",
        "none" if not lost else "; ".join(lost),
    ]
    print(f"| {' | '.join(cells)} |", flush=True)
    faults = [*log.faults[:5], *errors[:2]]
    for fault in faults:
        print(f"  fault: {fault}")
    return not lost and not faults


async def _break(scene: Scene, breaking: Break) -> None:
    habits = Habits(think_s=THINK_S, patient=True)
    seed = int(scene.rng.integers(2**31))
    slug, number = (STUDY, CROWD) if scene.machines is None else (fleet.STUDY, FEW)
    async with crowd(scene.server.url, slug, number, habits, scene.log, seed, arrive_s=1):
        async with asyncio.timeout(120 + 60 * scene.times):
            await breaking(scene)


if __name__ == "__main__":
    main()
