"""Making the library's videos ahead of time, on several processors.

Nothing is kept about the work itself: what is done is what lies in the folder. So it can be stopped
at any moment and started again, and two of it at once only share the work.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, wait
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import TypeAlias

from .environments import ENVIRONMENTS, candidates, environment_named
from .library import RUNS_PER_CANDIDATE, ensure_video

Recording: TypeAlias = tuple[str, int, int]  # environment, candidate index, run index
Progress: TypeAlias = Callable[[int, int], None]  # videos that are there, videos in all


class JobCountError(ValueError):
    """Work cannot be spread over this many processes."""


def recordings(environment: str | None = None) -> list[Recording]:
    """Every recording of an environment, or of all."""
    names = list(ENVIRONMENTS) if environment is None else [environment_named(environment).name]
    return [
        (name, index, run_index)
        for name in names
        for index in range(len(candidates()))
        for run_index in range(RUNS_PER_CANDIDATE)
    ]


def render_all(environment: str | None, media_dir: Path, jobs: int, on_progress: Progress) -> None:
    """Make every video of an environment (or of all) that is not in the folder yet."""
    render_these(recordings(environment), media_dir, jobs, on_progress)


def render_these(
    wanted: Sequence[Recording], media_dir: Path, jobs: int, on_progress: Progress
) -> None:
    """Make the videos of some recordings that are not in the folder yet.

    ``on_progress`` is called once at the start and after each video, in the caller's thread. An
    interrupt ends the work after the videos in hand, at most a second or two later.
    """
    if jobs < 1:
        raise JobCountError(f"expected at least 1 job, got {jobs!r}")
    on_progress(0, len(wanted))
    if jobs == 1:
        for done, recording in enumerate(wanted, start=1):
            ensure_video(*recording, media_dir)
            on_progress(done, len(wanted))
        return
    # Fresh processes rather than forks: the caller may hold threads and locks.
    pool = ProcessPoolExecutor(
        max_workers=min(jobs, max(len(wanted), 1)),
        mp_context=get_context("spawn"),
        initializer=_follow_the_caller,
    )
    try:
        waiting = {pool.submit(ensure_video, *recording, media_dir) for recording in wanted}
        _follow(waiting, len(wanted), on_progress)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _follow(waiting: set[Future[Path]], total: int, on_progress: Progress) -> None:
    while waiting:
        finished, waiting = wait(waiting, timeout=0.2, return_when=FIRST_EXCEPTION)
        for future in finished:
            future.result()
        if finished:
            on_progress(total - len(waiting), total)


def _follow_the_caller() -> None:
    """Set a worker up to end when the caller ends, and only then."""
    # A terminal interrupts every process at once; a worker finishes the video in its hands.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A caller that is killed cannot dismiss its workers, and they would wait for it for ever.
    threading.Thread(target=_end_with_the_caller, daemon=True).start()


def _end_with_the_caller() -> None:
    caller = parent_process()
    if caller is not None:
        caller.join()
        os._exit(1)
