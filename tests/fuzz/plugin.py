"""`pytest --fuzz SECONDS`: the same tests by chance, round after round, and a table at the end.

Without it each of them goes one short round, alike each time. A round says its seed: with
`--fuzz-seed` it comes again.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from secrets import randbits
from typing import Any, Final

import hypothesis
import pytest
from hypothesis import HealthCheck, Phase

from .watched_process import WatchedProcess

#: By how much a process with the application and its tests may grow after the first round.
MOST_GROWTH_MB: Final = 500


@dataclass
class Figures:
    """What one part has tried."""

    seconds: float = 0.0
    seeds: list[int] = field(default_factory=list)
    faults: int = 0
    grown_mb: float = 0.0
    operations: set[str] = field(default_factory=set)
    statuses: Counter[int] = field(default_factory=Counter)


class Fuzz:
    """How long each part goes on, and what came of it."""

    def __init__(self, seconds: float, first_seed: int | None) -> None:
        self.seconds = seconds
        self.parts: dict[str, Figures] = {}
        self._seeds = count(randbits(32) if first_seed is None else first_seed)

    def case(self, part: str, operation: str, status: int) -> None:
        """Note that something was asked, and answered with this status."""
        figures = self.parts.setdefault(part, Figures())
        figures.operations.add(operation)
        figures.statuses[status] += 1

    def rounds(self, part: str, one_round: Callable[[int], None]) -> None:
        """Call `one_round(seed)` once, or again and again until the time is over."""
        figures = self.parts.setdefault(part, Figures())
        began = time.monotonic()
        itself = WatchedProcess(os.getpid())
        at_first = 0.0
        for seed in self._seeds:
            figures.seeds.append(seed)
            try:
                one_round(seed)
                # What is kept between rounds is there after the first.
                at_first = at_first or itself.memory_mb
                figures.grown_mb = itself.memory_mb - at_first
                assert figures.grown_mb < MOST_GROWTH_MB, f"{figures.grown_mb:.0f} MB more"
            except BaseException:
                figures.faults += 1
                raise
            finally:
                figures.seconds = time.monotonic() - began
            if figures.seconds >= self.seconds:
                return

    def settings(self, examples: int, **more: Any) -> hypothesis.settings:
        """Of one round: so many examples, three times as many where there is time.

        The shortest way to a fault would take minutes to find: its seed leads there too.
        """
        return hypothesis.settings(
            max_examples=examples * (3 if self.seconds else 1),
            derandomize=not self.seconds,
            database=None,
            deadline=None,
            suppress_health_check=list(HealthCheck),
            phases=[Phase.generate],
            report_multiple_bugs=False,
            **more,
        )

    def table(self) -> Iterator[str]:
        yield f"{'part':<34}{'s':>6}{'operations':>12}{'cases':>8}{'faults':>8}{'MB':>6}  statuses"
        for part, one in self.parts.items():
            statuses = ", ".join(f"{status}: {n}" for status, n in sorted(one.statuses.items()))
            yield (
                f"{part:<34}{one.seconds:>6.0f}{len(one.operations):>12}"
                f"{one.statuses.total():>8}{one.faults:>8}{one.grown_mb:>6.0f}  {statuses}"
            )
            yield f"{'':<34}seeds {one.seeds[0]} to {one.seeds[-1]}" if one.seeds else ""


_FUZZ = pytest.StashKey[Fuzz]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fuzz", type=float, default=0.0, metavar="SECONDS", help="for each part")
    parser.addoption("--fuzz-seed", type=int, default=None, help="of the first round")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_FUZZ] = Fuzz(config.getoption("--fuzz"), config.getoption("--fuzz-seed"))


@pytest.fixture(scope="session")
def fuzz(pytestconfig: pytest.Config) -> Fuzz:
    return pytestconfig.stash[_FUZZ]


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    fuzz = config.stash[_FUZZ]
    if fuzz.seconds:
        terminalreporter.section("what was tried")
        for line in fuzz.table():
            terminalreporter.write_line(line)
