"""A machine in a process of its own: its first run is unsafe, its second fails, others record.

`python recording_machine.py URL STUDY TOKEN FOLDER`: FOLDER holds the video of every run, and a
file with a line for each run, which another such process goes on with.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "static" / "machine"))

from pbpo_machine import Unsafe, serve  # type: ignore[import-not-found]

URL, STUDY, TOKEN = sys.argv[1:4]
FOLDER = Path(sys.argv[4])


def record(_parameters: dict[str, float], video: Path, _rollout: Any) -> None:
    runs = FOLDER / "runs"
    before = len(runs.read_text().splitlines()) if runs.exists() else 0
    with runs.open("a") as log:
        log.write("run\n")
    if before == 0:
        raise Unsafe("it would hit the wall")
    if before == 1:
        raise RuntimeError("motor 3 is cold")
    shutil.copyfile(FOLDER / "video.mp4", video)


serve(URL, STUDY, TOKEN, record)
