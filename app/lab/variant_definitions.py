"""The variants of the optimiser that are compared, by name: the paper's method, ours, and changes.

`python -m app.lab.variants` compares them. docs/optimiser.md holds the tables and what was decided
from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

from app.pbbo import PRESETS, Settings


@dataclass(frozen=True)
class Variant:
    """settings: None for the paper's own, of the environment. may_skip: whether it is offered.

    ties: what becomes of "I cannot tell": it is learned as a tie, taken for "both are bad", or
    there is no such button, and an evaluator who cannot tell presses either side.
    """

    method: str
    settings: Settings | None
    may_skip: bool = True
    ties: Literal["learned", "as both bad", "forced"] = "learned"

    def settings_on(self, problem: str) -> Settings:
        """The settings on this problem; the paper has none for problems that are not its own."""
        if self.settings is not None:
            return self.settings
        preset = f"paper-{problem.removesuffix('-recorded')}"
        return PRESETS[preset if preset in PRESETS else "paper-env1"]


DEFAULT: Final = Settings()


def _changed(**changes: object) -> Variant:
    return Variant("pbpo-threshold", replace(DEFAULT, **changes))  # type: ignore[arg-type]


VARIANTS: Final[Mapping[str, Variant]] = {
    "pbpo, paper's preset": Variant("pbpo", None),
    "pbpo-threshold": Variant("pbpo-threshold", DEFAULT),
    "pbpo-threshold of engine 2": Variant("pbpo-threshold", Settings.from_mapping({}, "2")),
    "without skips": Variant("pbpo-threshold", DEFAULT, may_skip=False),
    "ties taken for both bad": Variant("pbpo-threshold", DEFAULT, ties="as both bad"),
    "ties forced to a choice": Variant("pbpo-threshold", DEFAULT, ties="forced"),
    "boldness 1": _changed(threshold_boldness=(1.0,)),
    "boldness 3": _changed(threshold_boldness=(3.0,)),
    "length scale 0.1": _changed(threshold_length_scales=(0.1,)),
    "length scale 0.33": _changed(threshold_length_scales=(0.33,)),
    "epsilon 0.3": _changed(threshold_epsilon=0.3),
    "epsilon 1": _changed(threshold_epsilon=1.0),
    "threshold noise 0.4": _changed(threshold_noise=0.4),
    "threshold as noisy as a choice": _changed(threshold_noise=1.0),
    "farthest points first": _changed(threshold_design="farthest"),
    "random pairs first": _changed(threshold_covering=0),
    "no first phase": _changed(threshold_covering=0, random_queries=0),
}
