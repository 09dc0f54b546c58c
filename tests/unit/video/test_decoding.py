"""Videos are looked into by a process with limits, whatever they do to it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app.video import limits
from app.video.decoder_client import MOST_DEATHS, Decoder
from app.video.probing import probe
from app.video.video_info import DecoderFailedError, NotTriedError, UnreadableVideoError
from tests.videos import write


@pytest.fixture
def decoder() -> Iterator[Decoder]:
    with Decoder() as decoder:
        yield decoder


def process_of(decoder: Decoder) -> subprocess.Popen[bytes]:
    assert decoder._process is not None
    return decoder._process


def limit(monkeypatch: pytest.MonkeyPatch, **values: Any) -> None:
    monkeypatch.setattr(limits, "PROBING", replace(limits.PROBING, **values))


def test_many_videos_are_looked_into_by_one_process_as_they_would_be_here(
    decoder: Decoder, tmp_path: Path
) -> None:
    paths = [write(tmp_path / "a.mp4"), write(tmp_path / "b.avi", "mpeg4")]
    (tmp_path / "no video.mp4").write_text("no video")
    found = [decoder.probe(path) for path in paths]
    first = process_of(decoder).pid
    assert found == [probe(path) for path in paths]
    with pytest.raises(UnreadableVideoError, match="it is no MP4"):
        decoder.probe(tmp_path / "no video.mp4")
    with pytest.raises(UnreadableVideoError, match="No such file"):
        decoder.probe(tmp_path / "gone.mp4")
    decoder.transcode(paths[1], tmp_path / "made.mp4")
    assert decoder.probe(tmp_path / "made.mp4").hindrance is None
    assert decoder.still(paths[0]).startswith(b"\xff\xd8")
    assert process_of(decoder).pid == first


def test_the_process_ends_with_its_batch(tmp_path: Path) -> None:
    with Decoder() as decoder:
        decoder.probe(write(tmp_path / "a.mp4"))
        process = process_of(decoder)
    assert process.returncode is not None


def test_the_process_ends_with_whoever_started_it(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "hang.mp4")
    program = """if True:
        import sys, threading, time
        from pathlib import Path
        from app.video.decoder_client import Decoder
        decoder = Decoder()
        threading.Thread(target=decoder.probe, args=(Path(sys.argv[1]),), daemon=True).start()
        while decoder._process is None:
            time.sleep(0.01)
        print(decoder._process.pid, flush=True)
        time.sleep(60)
    """
    words = [sys.executable, "-c", program, str(tmp_path / "hang.mp4")]
    with subprocess.Popen(words, stdout=subprocess.PIPE) as server:
        assert server.stdout is not None
        decoder = int(server.stdout.readline())
        # It holds the video.
        with (tmp_path / "hang.mp4").open("wb"):
            assert Path(f"/proc/{decoder}").exists()
            server.kill()
            deadline = time.monotonic() + 30
            while Path(f"/proc/{decoder}/exe").exists() and time.monotonic() < deadline:
                time.sleep(0.05)
            assert not Path(f"/proc/{decoder}/exe").exists()


def test_a_video_that_takes_too_much_memory_is_named_and_the_next_one_read(
    decoder: Decoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    large = write(tmp_path / "large.mov", "mjpeg", "yuvj420p", (7000, 7000), frames=1)
    limit(monkeypatch, memory_bytes=200_000_000)
    with pytest.raises(DecoderFailedError, match=r"could not be read: decoding it takes .* 200 MB"):
        decoder.probe(large)
    assert decoder.probe(write(tmp_path / "a.mp4")).width == 64
    monkeypatch.undo()
    assert decoder.probe(large).width == 7000


def test_a_process_that_hangs_is_replaced(
    decoder: Decoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Opening a pipe that nobody writes into lasts for ever.
    os.mkfifo(tmp_path / "hang.mp4")
    limit(monkeypatch, silent_s=0.3)
    with pytest.raises(DecoderFailedError, match=r"the decoder took longer than 0\.3 s"):
        decoder.probe(tmp_path / "hang.mp4")
    monkeypatch.undo()
    assert decoder.probe(write(tmp_path / "a.mp4")).width == 64


def test_a_process_that_uses_the_processor_up_is_ended(
    decoder: Decoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = write(tmp_path / "a.ts", "mpeg2video").read_bytes()
    os.mkfifo(tmp_path / "endless.ts")

    def go_on_for_ever() -> None:
        with suppress(BrokenPipeError), (tmp_path / "endless.ts").open("wb", buffering=0) as pipe:
            while True:
                pipe.write(content)

    threading.Thread(target=go_on_for_ever, daemon=True).start()
    limit(monkeypatch, processor_s=0)
    with pytest.raises(DecoderFailedError, match="longer than 0 s of the processor"):
        decoder.probe(tmp_path / "endless.ts")


def test_a_process_that_dies_costs_the_video_it_held_and_no_other(
    decoder: Decoder, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "hang.mp4")
    good = write(tmp_path / "a.mp4")
    decoder.probe(good)
    held = process_of(decoder)
    threading.Timer(0.2, held.kill).start()
    with pytest.raises(DecoderFailedError, match=r"could not be read: the decoder failed$"):
        decoder.probe(tmp_path / "hang.mp4")
    assert decoder.probe(good).width == 64
    # One that dies between two videos held none.
    process_of(decoder).kill()
    process_of(decoder).wait()
    assert decoder.probe(good).width == 64


def test_after_some_deaths_no_further_video_is_tried(
    decoder: Decoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "hang.mp4")
    limit(monkeypatch, silent_s=0.05)
    for _ in range(MOST_DEATHS):
        with pytest.raises(DecoderFailedError):
            decoder.probe(tmp_path / "hang.mp4")
    with pytest.raises(NotTriedError, match="not looked at: the decoder failed on 3 videos"):
        decoder.probe(write(tmp_path / "a.mp4"))


class EndedAfterItsWord:
    """A timer whose time is up in the very moment in which an answer has come."""

    daemon = False

    def __init__(self, _seconds: float, end: Callable[[], None]) -> None:
        self.cancel = end

    def start(self) -> None:
        pass

    def join(self) -> None:
        pass


def test_a_process_that_is_ended_right_after_its_word_is_asked_no_more(
    decoder: Decoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = write(tmp_path / "a.avi", "mpeg4", size=(320, 240))
    assert decoder.probe(source).duration_s > 0
    with monkeypatch.context() as patch:
        patch.setattr(threading, "Timer", EndedAfterItsWord)
        with pytest.raises(DecoderFailedError, match="took longer"):
            decoder.transcode(source, tmp_path / "new.mp4")
        with pytest.raises(DecoderFailedError, match="took longer"):
            decoder.probe(source)
    assert decoder.probe(source).duration_s > 0


def test_a_transcoding_that_is_ended_leaves_nothing(
    decoder: Decoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = write(tmp_path / "a.avi", "mpeg4", size=(320, 240))
    smaller = replace(limits.TRANSCODING, file_bytes=5_000)
    monkeypatch.setattr(limits, "TRANSCODING", smaller)
    with pytest.raises(UnreadableVideoError, match="File too large"):
        decoder.transcode(source, tmp_path / "new.mp4")
    monkeypatch.setattr(limits, "TRANSCODING", replace(smaller, silent_s=0.001))
    with pytest.raises(DecoderFailedError):
        decoder.transcode(source, tmp_path / "new.mp4")
    assert [path.name for path in tmp_path.iterdir()] == ["a.avi"]


def test_whoever_looks_into_videos_may_write_none_and_knows_no_secret(
    decoder: Decoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PBPO_DATABASE_URL", "postgresql://u:secret@h/d")
    decoder.probe(write(tmp_path / "a.mp4"))
    process = Path("/proc") / str(process_of(decoder).pid)
    assert b"secret" not in (process / "environ").read_bytes()
    said = (process / "limits").read_text()
    soft = {line[:26].strip(): line[26:].split()[0] for line in said.splitlines()}
    assert soft["Max file size"] == "0"
    assert soft["Max core file size"] == "0"
    assert soft["Max address space"] == str(limits.PROBING.memory_bytes)


def test_the_process_loads_no_more_than_it_needs() -> None:
    told = (
        "import sys, app.video.decoder_process;"
        " print(*{name.split('.')[0] for name in sys.modules})"
    )
    run = subprocess.run([sys.executable, "-c", told], check=True, capture_output=True, text=True)
    loaded = run.stdout.split()
    assert not {"torch", "numpy", "pydantic", "sqlalchemy", "fastapi"} & set(loaded)
    assert "av" in loaded
