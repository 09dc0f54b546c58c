"""The door to the decoding process: started with the first video, used for all that follow.

Videos come from people whom nobody has to trust, and decoders have had faults that such videos
use. A process that dies, hangs or takes too much costs one sentence on the video it held.
"""

from __future__ import annotations

import base64
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from pydantic import TypeAdapter, ValidationError

import app

from . import limits as defaults
from .limits import Limits
from .video_info import DecoderFailedError, NotTriedError, UnreadableVideoError, Video, part_of

#: The interpreter's start, on a machine that has other things to do.
START_S = 60.0
#: After so many deaths no further video of a batch is tried: each may have taken minutes.
MOST_DEATHS = 3
#: An answer is a line of JSON; a still is the longest.
_LONGEST_ANSWER = 4_000_000
_FAILED = "it could not be read: the decoder failed"
_ROOT = Path(app.__file__).parents[1]
#: Nothing of the server's environment: it may hold secrets. One arena for all threads, since each
#: further one takes address space that is never used.
_ENVIRONMENT = {
    "PYTHONPATH": str(_ROOT),
    "PYTHONDONTWRITEBYTECODE": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "1",
    # Where some systems' interpreters find their own libraries.
    **{name: os.environ[name] for name in ("LD_LIBRARY_PATH",) if name in os.environ},
}


@dataclass(frozen=True)
class _Answer:
    """One line of the process, which may be broken: it says nothing that is not one of these."""

    ready: bool = False
    at: float | None = None
    fault: str | None = None
    is_too_large: bool = False
    video: Video | None = None
    still: str | None = None
    is_made: bool = False
    form: str | None = None


_ANSWERS = TypeAdapter(_Answer)


class Decoder:
    """Looks into the videos of one batch; `with` ends its process."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._deaths = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def probe(self, path: Path) -> Video:
        """What the video is. Raises UnreadableVideoError."""
        said = self._ask(defaults.PROBING, "probe", path)
        if said.video is None:
            raise DecoderFailedError(_FAILED)
        return said.video

    def still(self, path: Path) -> bytes:
        """The frame in its middle, as JPEG. Raises UnreadableVideoError."""
        said = self._ask(defaults.PROBING, "still", path)
        return base64.b64decode(said.still or "")

    def transcode(
        self, source: Path, target: Path, at: Callable[[float], None] = lambda _seconds: None
    ) -> None:
        """Make `target`, which every browser plays, of `source`. Raises UnreadableVideoError.

        `at` is told how many seconds are done. The target appears whole or not at all.
        """
        try:
            said = self._ask(defaults.TRANSCODING, "transcode", source, target, at)
            if not said.is_made:
                raise DecoderFailedError(_FAILED)
        finally:
            part_of(target).unlink(missing_ok=True)

    def remux(self, source: Path, target: Path) -> str:
        """Copy the pictures to `target`, and no metadata; the form of both. As `remuxing.remux`."""
        try:
            said = self._ask(defaults.REMUXING, "remux", source, target)
            if said.form is None:
                raise DecoderFailedError(_FAILED)
            return said.form
        finally:
            part_of(target).unlink(missing_ok=True)

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            _close(process)

    def _ask(
        self,
        limits: Limits,
        do: str,
        source: Path,
        target: Path | None = None,
        at: Callable[[float], None] = lambda _seconds: None,
    ) -> _Answer:
        if self._deaths >= MOST_DEATHS:
            raise NotTriedError(
                f"it was not looked at: the decoder failed on {MOST_DEATHS} videos before it"
            )
        process = self._running()
        assert process.stdin is not None
        request = {"do": do, "source": str(source.absolute()), "limits": asdict(limits)}
        if target is not None:
            request["target"] = str(target.absolute())
        line = json.dumps(request)
        # One that died at this moment is found dead where its answer is read.
        with suppress(BrokenPipeError):
            process.stdin.write(line.encode() + b"\n")
            process.stdin.flush()
        while True:
            said = self._hear(process, limits.silent_s, limits)
            if said.fault is not None:
                raise UnreadableVideoError(said.fault)
            if said.is_too_large:
                megabytes = limits.memory_bytes // 1_000_000
                raise DecoderFailedError(
                    f"it could not be read: decoding it takes more than {megabytes:,} MB of memory"
                )
            if said.at is None:
                return said
            at(said.at)

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._process.poll() is None:
            return self._process
        self.close()
        self._process = subprocess.Popen(
            # Never a module from the folder one happens to be in: it may be somebody's study.
            [sys.executable, "-P", "-s", "-m", "app.video.decoder_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd="/",
            env=_ENVIRONMENT,
            # Ctrl+C is for whoever started us; they end this process.
            start_new_session=True,
        )
        self._hear(self._process, START_S, None)
        return self._process

    def _hear(
        self, process: subprocess.Popen[bytes], patience_s: float, limits: Limits | None
    ) -> _Answer:
        """What the process says next. Raises DecoderFailedError if it says nothing sensible."""
        assert process.stdout is not None
        is_late = threading.Event()

        def end() -> None:
            is_late.set()
            process.kill()

        timer = threading.Timer(patience_s, end)
        timer.daemon = True
        timer.start()
        try:
            line = process.stdout.readline(_LONGEST_ANSWER)
        finally:
            timer.cancel()
            # Only then is it certain whether the process was ended.
            timer.join()
        try:
            said = _ANSWERS.validate_json(line)
        except ValidationError:
            said = None
        if said is not None and not is_late.is_set():
            return said
        process.kill()
        _close(process)
        self._process = None
        if said is not None and said.at is None and limits is not None:
            # Its last words, in the last moment: nothing more is wanted of it.
            return said
        self._deaths += 1
        raise DecoderFailedError(_why(process.returncode, limits, patience_s, is_late.is_set()))


def _why(status: int, limits: Limits | None, patience_s: float, is_late: bool) -> str:
    if is_late:
        return f"it could not be read: the decoder took longer than {patience_s:g} s"
    if limits is not None and status == -signal.SIGXCPU:
        return (
            "it could not be read: the decoder took longer than"
            f" {limits.processor_s} s of the processor"
        )
    return _FAILED


def _close(process: subprocess.Popen[bytes]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(BrokenPipeError):
                pipe.close()
    process.wait()
