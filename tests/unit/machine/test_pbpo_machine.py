"""The program that a machine runs: it records, goes on after faults, gives back what is stopped."""

from __future__ import annotations

import ast
import base64
import hashlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from .fake_studio import FakeStudio

PROGRAM = Path(__file__).parents[3] / "static" / "machine" / "pbpo_machine.py"


@pytest.fixture(scope="module")
def program() -> ModuleType:
    spec = importlib.util.spec_from_file_location("pbpo_machine", PROGRAM)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.FIRST_PAUSE_S = 0.01  # type: ignore[attr-defined]
    return module


@pytest.fixture
def studio() -> Iterator[FakeStudio]:
    studio = FakeStudio()
    yield studio
    studio.close()


def once(program: ModuleType, studio: FakeStudio, record: Any) -> list[str]:
    """One rollout by a function; what the operator is told."""
    said: list[str] = []
    program.serve(studio.url, "crane", "secret", record, say=said.append, once=True)
    return said


def test_the_program_is_written_for_python_3_8() -> None:
    ast.parse(PROGRAM.read_text(encoding="utf-8"), feature_version=(3, 8))


def test_a_recording_arrives_whole_with_its_digest_and_score(
    program: ModuleType, studio: FakeStudio
) -> None:
    studio.ask("r1", w0=0.25)
    told: list[Any] = []

    def record(parameters: dict[str, float], video: Path, rollout: Any) -> dict[str, float]:
        told.append((parameters, rollout.seed, rollout.environment))
        video.write_bytes(b"video" * 1000)
        return {"score": 12.5}

    once(program, studio, record)
    assert told == [({"w0": 0.25}, 7, "pit")]
    assert studio.videos["r1"] == b"video" * 1000
    digest = base64.b64encode(hashlib.sha256(b"video" * 1000).digest()).decode()
    assert studio.digests["r1"] == f"sha-256=:{digest}:"
    assert studio.reports == [("r1", "measurements", {"score": 12.5, "series": None, "attempt": 1})]
    assert studio.tokens == {"Bearer secret"}


def test_an_upload_that_is_cut_goes_on_where_it_was(
    program: ModuleType, studio: FakeStudio, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "PIECE", 1000)
    studio.ask("r1")
    data = os.urandom(4321)

    def record(_parameters: Any, video: Path, _rollout: Any) -> None:
        video.write_bytes(data)
        # A piece is cut in its middle, and then the server is away for a moment.
        studio.faults = [0, 503]

    once(program, studio, record)
    assert studio.videos["r1"] == data


def test_a_server_that_has_less_than_was_sent_gets_it_again(
    program: ModuleType, studio: FakeStudio, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "PIECE", 1000)
    studio.ask("r1")
    data = os.urandom(3500)
    store = studio._store

    def forgets(request: Any, body: bytes) -> tuple[int, dict[str, Any]]:
        if request.headers["Content-Range"].startswith("bytes 2000-") and not forgotten:
            forgotten.append(True)
            studio.videos.clear()
        return store(request, body)

    forgotten: list[bool] = []
    monkeypatch.setattr(studio, "_store", forgets)
    once(program, studio, lambda _parameters, video, _rollout: video.write_bytes(data) and None)
    assert forgotten
    assert studio.videos["r1"] == data


@pytest.mark.parametrize(
    ("error", "report"),
    [("Unsafe", "unsafe"), ("Failed", "failed"), ("RuntimeError", "failed")],
)
def test_what_the_machine_raises_is_reported_in_its_words(
    program: ModuleType, studio: FakeStudio, error: str, report: str
) -> None:
    studio.ask("r1")
    kind = getattr(program, error, RuntimeError)

    def record(_parameters: Any, _video: Path, _rollout: Any) -> None:
        raise kind("the arm hit the wall")

    once(program, studio, record)
    [(name, what, said)] = studio.reports
    assert (name, what, said["reason"]) == ("r1", report, "the arm hit the wall")


def test_no_video_is_a_failure(program: ModuleType, studio: FakeStudio) -> None:
    studio.ask("r1")
    once(program, studio, lambda *_: None)
    [(_, what, said)] = studio.reports
    assert what == "failed"
    assert "expected a video" in said["reason"]


def test_a_rollout_that_is_lost_ends_its_run(program: ModuleType, studio: FakeStudio) -> None:
    studio.ask("r1")
    studio.hold = lambda: (409, {"detail": "another machine has it"})

    def record(_parameters: Any, video: Path, rollout: Any) -> None:
        video.write_bytes(b"video")
        while True:
            rollout.check()
            time.sleep(0.005)

    said = once(program, studio, record)
    assert any("another machine has it" in line for line in said)
    assert studio.videos == {}
    assert studio.reports[0][2]["give_back"] is True


def test_a_long_run_sends_heartbeats_with_its_progress(
    program: ModuleType, studio: FakeStudio
) -> None:
    studio.ask("r1")

    def record(_parameters: Any, video: Path, rollout: Any) -> None:
        rollout.progress(0.5)
        while not any(beat.get("progress") == 0.5 for beat in studio.beats):
            time.sleep(0.005)
        video.write_bytes(b"video")

    once(program, studio, record)
    assert studio.videos["r1"] == b"video"


def test_a_token_that_is_refused_ends_the_program(program: ModuleType, studio: FakeStudio) -> None:
    studio.faults = [401]
    with pytest.raises(program.Refused):
        once(program, studio, lambda *_: None)


def run(studio: FakeStudio, script: str, *more: str, python: str = sys.executable) -> Any:
    """The command form with a command of Python that has the video's path as its first argument."""
    words = [python, str(PROGRAM), "--url", studio.url, "--study", "crane", *more, "--"]
    environ = {**os.environ, "PBPO_MACHINE_TOKEN": "secret"}
    return subprocess.Popen(
        [*words, python, "-c", script, "{video}", "{w0}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environ,
    )


def pythons() -> list[str]:
    """The Python of the tests, and the oldest and the newest from 3.8 on that this machine has."""
    found: dict[int, str] = {}
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for minor in range(8, 16):
        on_path = shutil.which(f"python3.{minor}")
        for path in (*versions.glob(f"3.{minor}.*/bin/python3.{minor}"), on_path):
            # A stand-in of a version manager is found, and runs nothing.
            if (
                path
                and subprocess.run([path, "-c", ""], capture_output=True, check=False).returncode
                == 0
            ):
                found[minor] = str(path)
                break
    chosen = [found[minor] for minor in (min(found), max(found))] if found else []
    return list(dict.fromkeys([sys.executable, *chosen]))


@pytest.mark.parametrize("python", pythons())
def test_a_command_is_run_with_the_values_and_its_report_is_sent(
    studio: FakeStudio, python: str
) -> None:
    studio.ask("r1", w0=0.25)
    script = "import sys; open(sys.argv[1], 'w').write(sys.argv[2]); print('pbpo: score 3.5')"
    process = run(studio, script, "--once", python=python)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0, out
    assert studio.videos["r1"] == b"0.25"
    assert studio.reports[0][2]["score"] == 3.5


@pytest.mark.parametrize(
    ("script", "report", "reason"),
    [
        ("import sys; print('too steep', file=sys.stderr); sys.exit(3)", "unsafe", "too steep"),
        (
            "import sys; print('no grip', file=sys.stderr); sys.exit(1)",
            "failed",
            "exit status 1: no grip",
        ),
    ],
)
def test_an_exit_status_says_what_happened(
    studio: FakeStudio, script: str, report: str, reason: str
) -> None:
    studio.ask("r1", w0=0.25)
    process = run(studio, script, "--once")
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0, out
    [(_, what, said)] = studio.reports
    assert (what, said["reason"]) == (report, reason)


def test_a_command_that_takes_too_long_is_ended(studio: FakeStudio) -> None:
    studio.ask("r1", timeout_s=0.3, w0=0.25)
    process = run(studio, "import time; time.sleep(600)", "--once")
    process.communicate(timeout=60)
    [(_, what, said)] = studio.reports
    assert what == "failed"
    assert "longer than 0.3 seconds" in said["reason"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_that_is_stopped_gives_its_rollout_back_and_ends_the_command(
    studio: FakeStudio, tmp_path: Path, number: int
) -> None:
    studio.ask("r1", w0=0.25)
    begun = tmp_path / "pid"
    script = (
        f"import os, time; open({str(begun)!r} + '~', 'w').write(str(os.getpid()));"
        f"os.rename({str(begun)!r} + '~', {str(begun)!r}); time.sleep(600)"
    )
    process = run(studio, script)
    while not begun.exists():
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode == 130
    [(name, what, said)] = studio.reports
    assert (name, what, said["give_back"]) == ("r1", "failed", True)
    with pytest.raises(ProcessLookupError):
        os.kill(int(begun.read_text()), 0)


def test_what_a_command_has_started_is_ended_too_where_it_does_not_stop_by_itself(
    program: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    stubborn = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN);"
        "print('begun', flush=True); time.sleep(600)"
    )
    script = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {stubborn!r}])"
    command = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert command.stdout is not None
    assert command.stdout.readline() == "begun\n"
    monkeypatch.setattr(program, "ENDING_S", 0.2)
    program._end(command)
    # What it has started holds the other end of the pipe for as long as it runs.
    out, _ = command.communicate(timeout=60)
    assert out == ""


def test_a_place_that_no_parameter_has_is_named(studio: FakeStudio) -> None:
    studio.ask("r1", speed=1.0)
    process = run(studio, "pass", "--once")
    out, _ = process.communicate(timeout=60)
    assert process.returncode != 0
    assert "got {w0}" in out
