"""Making all videos ahead of time: counted, skipped when there, interrupted and resumed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import app
from app.crane import library, rendering_jobs
from app.crane.dynamics import Run
from app.crane.environments import UnknownEnvironmentError
from app.crane.rendering_jobs import JobCountError, recordings, render_all, render_these

SOME = [("env1", 3, 0), ("env1", 3, 1), ("env2", 5, 0), ("env2", 5, 1)]


def nothing_to_tell(done: int, total: int) -> None:
    """A caller that shows no progress."""


@pytest.fixture
def quick_render(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    written: list[Path] = []

    def render(run: Run, path: Path) -> None:
        written.append(path)
        path.write_bytes(b"video")

    monkeypatch.setattr(library, "render", render)
    return written


def test_there_are_five_recordings_of_each_of_231_candidates_in_two_environments() -> None:
    assert len(recordings("env1")) == 1155
    assert len(set(recordings())) == 2310


def test_an_unknown_environment_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownEnvironmentError, match="env9"):
        render_all("env9", tmp_path, 1, nothing_to_tell)


def test_no_jobs_at_all_are_refused(tmp_path: Path) -> None:
    with pytest.raises(JobCountError, match="at least 1 job, got 0"):
        render_these(SOME, tmp_path, 0, nothing_to_tell)


def test_progress_counts_up_to_the_whole(tmp_path: Path, quick_render: list[Path]) -> None:
    seen: list[tuple[int, int]] = []

    render_these(SOME, tmp_path, 1, lambda done, total: seen.append((done, total)))

    assert seen == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]
    assert len(list(tmp_path.iterdir())) == 4


def test_all_videos_of_an_environment_are_made(
    tmp_path: Path, quick_render: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rendering_jobs, "RUNS_PER_CANDIDATE", 1)

    render_all("env2", tmp_path, 1, nothing_to_tell)

    assert {path.name for path in tmp_path.iterdir()} == {
        library.video_name("env2", index, 0) for index in range(231)
    }


def test_work_that_was_interrupted_goes_on_where_it_stopped(
    tmp_path: Path, quick_render: list[Path]
) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_these(SOME, tmp_path, 1, interrupt)
    assert len(quick_render) == len(list(tmp_path.iterdir())) == 2

    render_these(SOME, tmp_path, 1, nothing_to_tell)

    assert len(quick_render) == len(list(tmp_path.iterdir())) == 4


def test_several_processes_share_the_work(tmp_path: Path) -> None:
    wanted = [SOME[0], SOME[2]]
    seen: list[tuple[int, int]] = []

    render_these(wanted, tmp_path, 2, lambda done, total: seen.append((done, total)))

    assert seen[0] == (0, 2)
    assert seen[-1] == (2, 2)
    assert {path.name for path in tmp_path.iterdir()} == {
        library.video_name(*recording) for recording in wanted
    }


def test_a_fault_in_another_process_reaches_the_caller(tmp_path: Path) -> None:
    not_a_folder = tmp_path / "file"
    not_a_folder.write_bytes(b"")

    with pytest.raises(FileExistsError):
        render_these(SOME, not_a_folder, 2, nothing_to_tell)


def test_workers_end_with_a_caller_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "caller.py"
    script.write_text(
        "import sys; from pathlib import Path\n"
        "from app.crane.rendering_jobs import render_all\n"
        "if __name__ == '__main__':\n"
        "    render_all('env1', Path(sys.argv[1]), 2, lambda *told: print(*told, flush=True))\n"
    )
    caller = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path / "media")],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(Path(app.__file__).parents[1])},
    )
    assert caller.stdout is not None
    with caller.stdout as told:
        while (line := told.readline()) and line.startswith(b"0 "):
            pass
        assert line, "the caller ended before its first video"
        caller.kill()
        caller.wait()
        # The workers hold the other end too: reading ends when the last of them is gone.
        told.read()
