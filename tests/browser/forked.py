"""The same server, forked from a process that has loaded it already."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from signal import Signals

from tests.forked import Forked, Process

from .server import Server


class ForkedServer(Server):
    """A server as `Server` is. What it wrote is printed when it ends."""

    def _launched(self, words: Sequence[str], environment: Mapping[str, str]) -> Process:
        self._log = self.data_dir.parent / f"server-{self.port}.log"
        return Forked(words, environment, self._log)

    def _end(self, how: Signals) -> None:
        super()._end(how)
        # Into what pytest shows of a test that failed.
        print(self._log.read_text(errors="replace"), file=sys.stderr)
