"""A server of our own in a process of its own, as people start it."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.forked import Forked, Process

from .started import Started

PBPO = Path(sys.executable).with_name("pbpo")


class Served(Started):
    """`pbpo serve` or `pbpo demo` on a free port. `url` is where it answers.

    A demo is begun by its command; a server is forked, and loads nothing.
    """

    url = ""

    def __init__(self, command: str, data_dir: Path, media_dir: Path, *more: str) -> None:
        words = [str(PBPO), command, "--port", "0", "--data-dir", str(data_dir), *more]
        log = data_dir.parent / f"{command}.log"
        super().__init__(words, log, PBPO_MEDIA_DIR=str(media_dir))

    def _begun(self, words: Sequence[str], environment: Mapping[str, str], log: Path) -> Process:
        if words[1] == "demo":
            return super()._begun(words, environment, log)
        log.write_text("")
        return Forked(["app.cli", *words[1:]], environment, log)

    def is_ready(self) -> bool:
        found = re.search(r"http://127\.0\.0\.1:\d+", self.output)
        self.url = found[0] if found else ""
        return bool(found)
