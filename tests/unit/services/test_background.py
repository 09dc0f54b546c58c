"""The door to work that nobody waits for."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest

from app.services.background.local import LocalBackground


@pytest.fixture
def background() -> Iterator[LocalBackground]:
    background = LocalBackground(1)
    yield background
    background.close()


def test_the_same_work_asked_for_twice_is_done_once(background: LocalBackground) -> None:
    let_go, done = threading.Event(), []

    def work() -> None:
        let_go.wait(10)
        done.append(1)

    futures = [background.in_thread("key", work) for _ in range(3)]
    let_go.set()
    for future in futures:
        future.result(10)
    assert done == [1]
    background.in_thread("key", work).result(10)
    assert done == [1, 1]


def test_work_that_fails_tells_who_waits_and_the_log_and_stops_nothing(
    background: LocalBackground, caplog: pytest.LogCaptureFixture
) -> None:
    def fail() -> None:
        raise ValueError("no such thing")

    with pytest.raises(ValueError, match="no such thing"):
        background.in_thread("fails", fail).result(10)
    assert background.in_thread("works", lambda: 7).result(10) == 7
    assert "'fails' failed" in caplog.text


def test_what_somebody_waits_for_overtakes_what_may_be_needed_later(
    background: LocalBackground, tmp_path: Path
) -> None:
    order = tmp_path / "order"
    first = background.in_process("first", _note, order, "first", 0.3)
    later = [background.in_process(name, _note, order, name, 0.0) for name in ("a", "b")]
    urgent = background.in_process("urgent", _note, order, "urgent", 0.0, urgent=True)
    overtaken = background.in_process("b", _note, order, "b", 0.0, urgent=True)
    for future in (first, *later, urgent, overtaken):
        future.result(30)
    assert order.read_text().split() == ["first", "b", "urgent", "a"]


def test_a_worker_that_is_killed_is_replaced(background: LocalBackground) -> None:
    pid = background.in_process("who", os.getpid).result(30)
    assert pid != os.getpid()
    os.kill(pid, signal.SIGKILL)
    deadline = time.monotonic() + 30
    while True:
        assert time.monotonic() < deadline
        try:
            # The pool may not know yet that its worker has gone: this one may go with it.
            assert background.in_process("who now", os.getpid).result(30) != pid
        except BrokenProcessPool:
            time.sleep(0.05)
        else:
            break


def test_closing_drops_what_has_not_begun(tmp_path: Path) -> None:
    background = LocalBackground(1)
    order = tmp_path / "order"
    first = background.in_process("first", _note, order, "first", 0.2)
    dropped = background.in_process("dropped", _note, order, "dropped", 0.0)
    while not first.running():
        time.sleep(0.01)
    background.close()
    assert dropped.cancelled()
    assert first.done()


OF_A_KILLED_SERVER = """
import os, sys, time
from app.services.background.local import LocalBackground
if __name__ == "__main__":
    # A pool that nothing refers to is collected, and its worker leaves with it.
    background = LocalBackground(1)
    print(background.in_process("who", os.getpid).result(), flush=True)
    time.sleep(60)
"""


def test_workers_leave_when_their_server_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "server.py"
    script.write_text(OF_A_KILLED_SERVER)
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE) as server:
        assert server.stdout is not None
        worker = int(server.stdout.readline())
        assert _runs(worker)
        server.kill()
    deadline = time.monotonic() + 20
    while _runs(worker):
        assert time.monotonic() < deadline, "the worker outlived its server"
        time.sleep(0.02)


def test_jobs_come_one_after_the_other_and_none_twice_at_a_time(
    background: LocalBackground, tmp_path: Path
) -> None:
    notes, died = tmp_path / "notes", list[int]()
    for name in ("first", "first", "second"):
        background.as_job(name, _note, notes, name, 0.5, died=died.append)
    _wait_for(lambda: notes.exists() and "second" in notes.read_text())
    assert notes.read_text().split() == ["first", "second"]
    assert died == []


def test_a_job_whose_process_is_killed_is_told_of(background: LocalBackground) -> None:
    died: list[int] = []
    background.as_job("killed", _kill_oneself, died=died.append)
    _wait_for(lambda: bool(died))
    assert died == [-signal.SIGKILL]


def test_the_end_of_the_server_stops_a_job_at_once(tmp_path: Path) -> None:
    background, died = LocalBackground(1), list[int]()
    notes = tmp_path / "notes"
    background.as_job("long", _note, notes, "long", 600.0, died=died.append)
    _wait_for(notes.exists)
    started = time.monotonic()
    background.close()
    assert time.monotonic() - started < 20
    # Whoever keeps the job begins it again: it was stopped, and did not fail.
    assert died == []


def _wait_for(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not happened():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.02)


def _kill_oneself() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _note(file: Path, name: str, seconds: float) -> None:
    """Work of a test: write down that it was done."""
    with file.open("a") as notes:
        notes.write(f"{name}\n")
    time.sleep(seconds)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # Where nobody buries orphans, a process that has ended stays in the table as a zombie.
    status = Path(f"/proc/{pid}/stat")
    try:
        return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
