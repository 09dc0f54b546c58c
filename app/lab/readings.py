"""What we think the results mean: captions of the figures, and readings bound to verdicts.

A reading was written from a full run. It appears in a report only where the verdicts it speaks of
came out as they did in that run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

CAPTIONS: Final[Mapping[int, str]] = MappingProxyType(
    {
        9: "mean and deviation of g over W",
        10: "f acquired after each query, Certain",
        11: "f acquired after 40, 60 and 80 queries, Certain",
        12: "f acquired after each query, Uncertain",
        13: "f acquired after 40, 60 and 80 queries, Uncertain",
        17: "f acquired with and without skip and synthesis, simulated stand-ins for people",
        18: "f acquired by PBPO (simulated stand-ins for people), RBO and BO",
        19: "where on W the acquired parameters lie",
        20: "posterior means of the best and the worst trial after 60 crane runs",
        21: "skips of the simulated stand-ins for people",
    }
)


@dataclass(frozen=True)
class Reading:
    """A remark on the claims it names.

    when: the verdicts of these claims, in the run it was written from; those of all others do
    not matter to it.
    """

    when: Mapping[str, bool]
    text: str

    def applies(self, verdicts: Mapping[str, bool]) -> bool:
        """Whether these verdicts are those it was written from."""
        return all(verdicts.get(name) == holds for name, holds in self.when.items())


READINGS: Final[Mapping[int, tuple[Reading, ...]]] = MappingProxyType({})
