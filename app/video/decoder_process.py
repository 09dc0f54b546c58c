"""What the decoding process runs: it reads what to do, a line each, and writes what came of it.

Its limits come with each request. Standard output belongs to the answers alone, so whatever a
library prints goes nowhere.
"""

from __future__ import annotations

import base64
import json
import os
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

from .encoding import transcode
from .limits import Limits, be_the_first_to_go, keep_to
from .probing import probe
from .remuxing import remux
from .stills import still
from .video_info import UnreadableVideoError

#: How often it is looked whether somebody still waits for an answer, in seconds.
_LOOKS_EVERY_S = 1.0


def main() -> None:
    """Serve whoever started this process, until they close its input."""
    # What evaluators wait for comes first.
    os.nice(5)
    be_the_first_to_go()
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    _say(answers, ready=True)
    for line in sys.stdin.buffer:
        request = json.loads(line)
        keep_to(Limits(**request.pop("limits")))
        try:
            _say(answers, **_do(answers, **request))
        except MemoryError:
            _say(answers, is_too_large=True)
        except UnreadableVideoError as error:
            _say(answers, fault=str(error))


def _end_with(parent: int) -> None:
    """Leave when whoever started us is gone: a video may take long, and nobody waits for it."""
    while os.getppid() == parent:
        time.sleep(_LOOKS_EVERY_S)
    os._exit(1)


def _do(answers: IO[bytes], do: str, source: str, target: str = "") -> dict[str, Any]:
    match do:
        case "probe":
            return {"video": asdict(probe(Path(source)))}
        case "still":
            return {"still": base64.b64encode(still(Path(source))).decode("ascii")}
        case "remux":
            return {"form": remux(Path(source), Path(target))}
        case "transcode":
            transcode(Path(source), Path(target), _Seconds(answers))
            return {"is_made": True}
    raise ValueError(f"expected probe, still, remux or transcode, got {do!r}")


class _Seconds:
    """Tells of each second that is done, once."""

    def __init__(self, answers: IO[bytes]) -> None:
        self._answers = answers
        self._told = -1

    def __call__(self, seconds: float) -> None:
        if int(seconds) > self._told:
            self._told = int(seconds)
            _say(self._answers, at=seconds)


def _say(answers: IO[bytes], **said: Any) -> None:
    answers.write(json.dumps(said).encode() + b"\n")
    answers.flush()


if __name__ == "__main__":
    main()
