"""The settings of a preference optimiser, one frozen value, and the paper's own as presets.

Length scales are given in the ordinary convention, k(x, x') = s2 exp(-d^2 / (2 l^2)), in units of
the search space scaled to the unit cube. The paper's "length scale 0.01" (Section VI-A) cannot be
meant so: on its grid of step 0.05 neighbouring candidates would have correlation 3.7e-6. Read as
k = exp(-d^2 / (2 l)) it is an ordinary length scale of sqrt(0.01) = 0.1, which is what the presets
hold (`ordinary_length_scale`).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from math import isfinite, sqrt
from types import MappingProxyType
from typing import Any, Final, Literal

from .engine import EARLIER_ENGINES, ENGINE_VERSION
from .errors import SettingsError
from .preferences import SKIP_REASONS, SkipReason

Acquisition = Literal["thompson"]
ACQUISITIONS: Final[tuple[Acquisition, ...]] = ("thompson",)

Design = Literal["sobol", "farthest"]
DESIGNS: Final[tuple[Design, ...]] = ("sobol", "farthest")

# Beyond these the kernel matrix is numerically the identity, or numerically of rank one.
SHORTEST_LENGTH_SCALE: Final = 1e-4
LONGEST_LENGTH_SCALE: Final = 1e3
# Signal standard deviation over epsilon. Ten times the paper's sharpest evaluator; beyond, the
# precisions of contradictory answers (its square) leave float64 too few digits.
LARGEST_SIGNAL_TO_NOISE: Final = 1e5
# Below, every answer is a coin flip to within float64's rounding, whatever the candidates are.
SMALLEST_SIGNAL_TO_NOISE: Final = 1e-6

# Noise of a comparison with the threshold over that of two candidates; its inverse is the largest.
SHARPEST_THRESHOLD: Final = 0.01


# What the defaults of pbpo-threshold were under earlier engines: a trial that began under one goes
# on under its settings, and is replayed under them.
EARLIER_DEFAULTS: Final[Mapping[str, Any]] = MappingProxyType(
    {
        "threshold_epsilon": 0.3,
        "threshold_noise": 0.4,
        "threshold_covering": 0,
        "threshold_design": "farthest",
        "threshold_boldness": (1.0, 1.0, 3.0),
    }
)


def ordinary_length_scale(paper_length_scale: float) -> float:
    """The ordinary length scale of a kernel the paper writes as exp(-d^2 / (2 l))."""
    return sqrt(paper_length_scale)


@dataclass(frozen=True)
class Settings:
    """How a `PreferenceOptimizer` models the answers and chooses queries.

    length_scale: of the RBF kernel, in units of the unit cube (of the candidates' own units when
        `scale_candidates` is off). With `optimise_kernel`, where its optimisation starts.
    epsilon: noise of an answer, in units of the latent function: P(left wins) is
        Phi((f_left - f_right) / (sqrt(2) epsilon)).
    signal_variance: prior variance of the latent function. Only its ratio to epsilon^2 matters.
    random_queries: queries are random until this many answers that are not skips were given.
    optimise_kernel: fit the length scale too, in turn with the posterior, by automatic
        differentiation of the evidence lower bound.
    acquisition: how a query is chosen from the posterior.
    scale_candidates: scale each parameter by its range over the candidates to [0, 1] first.

    `pbpo-threshold` has settings of its own in place of `length_scale`, `epsilon`,
    `optimise_kernel` and `acquisition`; docs/optimiser.md says how they were chosen.

    threshold_length_scales: the length scales averaged over, for two parameters; for d parameters
        they are stretched by sqrt(d / 2), as typical distances are.
    threshold_epsilon: noise of an answer, as `epsilon`.
    threshold_noise: noise of a comparison with the threshold, as a share of `threshold_epsilon`.
    threshold_covering: how many queries at first cover the space, whatever the answers, in place
        of `random_queries`; with 0, these are random as for the other methods.
    threshold_design: how they cover it: by the candidates nearest to scrambled Sobol points
        ("sobol"), or by farthest points ("farthest"), which gather in corners.
    threshold_skip_means: what a skip without a reason says: "both_bad", that both lie below the
        threshold, or "cannot_tell", that the two are about equal.
    threshold_boldness: how bold the choice of a query is, for one query after the other, from the
        first again after the last.
    """

    length_scale: float = 0.1
    epsilon: float = 0.01
    signal_variance: float = 1.0
    random_queries: int = 5
    optimise_kernel: bool = False
    acquisition: Acquisition = "thompson"
    scale_candidates: bool = True
    threshold_length_scales: tuple[float, ...] = (0.07, 0.12, 0.22, 0.4, 0.7)
    threshold_epsilon: float = 0.6
    threshold_noise: float = 0.7
    threshold_covering: int = 6
    threshold_design: Design = "sobol"
    threshold_skip_means: SkipReason = "both_bad"
    threshold_boldness: tuple[float, ...] = (2.0,)

    def __post_init__(self) -> None:
        for name in (
            "length_scale",
            "epsilon",
            "signal_variance",
            "threshold_epsilon",
            "threshold_noise",
        ):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        for name in ("threshold_length_scales", "threshold_boldness"):
            object.__setattr__(self, name, several(name, getattr(self, name)))
        for length_scale in (self.length_scale, *self.threshold_length_scales):
            within_reach(length_scale)
        for name in ("epsilon", "threshold_epsilon"):
            audible(name, getattr(self, name), self.signal_variance)
        if not SHARPEST_THRESHOLD <= self.threshold_noise <= 1.0 / SHARPEST_THRESHOLD:
            raise SettingsError(
                f"threshold_noise: expected {SHARPEST_THRESHOLD:g} to {1 / SHARPEST_THRESHOLD:g}, "
                f"got {self.threshold_noise!r}"
            )
        whole("random_queries", self.random_queries)
        whole("threshold_covering", self.threshold_covering)
        for name in ("optimise_kernel", "scale_candidates"):
            flag(name, getattr(self, name))
        if self.acquisition not in ACQUISITIONS:
            raise SettingsError(
                f"acquisition: expected one of {', '.join(ACQUISITIONS)}, got {self.acquisition!r}"
            )

        if self.threshold_design not in DESIGNS:
            raise SettingsError(
                f"threshold_design: expected {' or '.join(DESIGNS)}, got {self.threshold_design!r}"
            )
        if self.threshold_skip_means not in SKIP_REASONS:
            raise SettingsError(
                f"threshold_skip_means: expected {' or '.join(SKIP_REASONS)}, "
                f"got {self.threshold_skip_means!r}"
            )

    @classmethod
    def from_mapping(
        cls, mapping: Mapping[str, Any], engine_version: str = ENGINE_VERSION
    ) -> "Settings":
        """Settings from a study's plan: an optional `preset`, and keys that override it.

        engine_version: what the plan does not say is as it was under this version.
        """
        given = defaults_under(engine_version) | dict(mapping)
        base = cls()
        if "preset" in given:
            name = given.pop("preset")
            if not isinstance(name, str) or name not in PRESETS:
                raise SettingsError(f"preset: expected one of {', '.join(PRESETS)}, got {name!r}")
            base = PRESETS[name]
        return override(base, given)

    def to_mapping(self) -> dict[str, Any]:
        """Every setting by name: what `from_mapping` turns back into this value."""
        return asdict(self)


@dataclass(frozen=True)
class ScoreSettings:
    """How a `ScoreOptimizer` models the scores and chooses the next candidate.

    kappa: of the upper confidence bound, mean + kappa std.
    length_scale, signal_variance, scale_candidates: as for `Settings`; scores are standardised.
    noise: standard deviation of a measurement, in standard deviations of the scores. The paper
        does not give it.
    degrees_of_freedom: of RBO's Student-t likelihood; the fewer, the more it forgives. Four are
        the usual choice: heavy tails, yet a finite variance.
    random_queries: how many random candidates are measured first.
    """

    kappa: float = 2.0
    length_scale: float = 0.1
    noise: float = 0.1
    signal_variance: float = 1.0
    degrees_of_freedom: float = 4.0
    random_queries: int = 5
    scale_candidates: bool = True

    def __post_init__(self) -> None:
        for name in ("length_scale", "noise", "signal_variance", "degrees_of_freedom"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        within_reach(self.length_scale)
        if isinstance(self.kappa, bool) or not isinstance(self.kappa, (int, float)):
            raise SettingsError(f"kappa: expected a number from 0 on, got {self.kappa!r}")
        if not isfinite(self.kappa) or self.kappa < 0:
            raise SettingsError(f"kappa: expected a finite number from 0 on, got {self.kappa!r}")
        whole("random_queries", self.random_queries)
        flag("scale_candidates", self.scale_candidates)


def defaults_under(engine_version: str) -> dict[str, Any]:
    """The settings whose defaults were others under this version of the engine, with these."""
    return dict(EARLIER_DEFAULTS) if engine_version in EARLIER_ENGINES else {}


def override(base: Settings, given: Mapping[str, Any]) -> Settings:
    """`base` with the given settings, or `SettingsError` naming the first unknown key."""
    known = [field.name for field in fields(base)]
    for name in given:
        if name not in known:
            raise SettingsError(
                f"{name!r}: expected a setting, one of preset, {', '.join(known)}; got {name!r}"
            )
    return replace(base, **given)


def positive(name: str, value: object) -> float:
    """A finite number above zero as a float, or `SettingsError`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingsError(f"{name}: expected a number above 0, got {value!r}")
    if not isfinite(value) or value <= 0:
        raise SettingsError(f"{name}: expected a finite number above 0, got {value!r}")
    return float(value)


def several(name: str, values: object) -> tuple[float, ...]:
    """A sequence of at least one positive number as a tuple, or `SettingsError`."""
    if not isinstance(values, (list, tuple)) or not values:
        raise SettingsError(f"{name}: expected a list of at least one number, got {values!r}")
    return tuple(positive(f"{name}[{place}]", value) for place, value in enumerate(values))


def audible(name: str, epsilon: float, signal_variance: float) -> None:
    """Refuse a noise that drowns every signal, or one too small for float64."""
    ratio = sqrt(signal_variance) / epsilon
    if not SMALLEST_SIGNAL_TO_NOISE <= ratio <= LARGEST_SIGNAL_TO_NOISE:
        raise SettingsError(
            f"{name}: expected sqrt(signal_variance) / {name} from "
            f"{SMALLEST_SIGNAL_TO_NOISE:g} to {LARGEST_SIGNAL_TO_NOISE:g}, got {ratio:g} "
            f"({name} {epsilon!r}, signal_variance {signal_variance!r})"
        )


def within_reach(length_scale: float) -> None:
    """Refuse a length scale at which the kernel matrix means nothing."""
    if not SHORTEST_LENGTH_SCALE <= length_scale <= LONGEST_LENGTH_SCALE:
        raise SettingsError(
            f"length_scale: expected {SHORTEST_LENGTH_SCALE} to {LONGEST_LENGTH_SCALE:g}, "
            f"got {length_scale!r}"
        )


def whole(name: str, value: object) -> None:
    """Refuse what is not a whole number from 0 on."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise SettingsError(f"{name}: expected a whole number from 0 on, got {value!r}")


def flag(name: str, value: object) -> None:
    """Refuse what is neither true nor false."""
    if not isinstance(value, bool):
        raise SettingsError(f"{name}: expected true or false, got {value!r}")


# Section VI-A: l = 0.01 in both environments, epsilon 0.01 (Env1) and 0.0001 (Env2).
PAPER_LENGTH_SCALE: Final = 0.01
PRESETS: Final[Mapping[str, Settings]] = MappingProxyType(
    {
        "paper-env1": Settings(
            length_scale=ordinary_length_scale(PAPER_LENGTH_SCALE), epsilon=0.01
        ),
        "paper-env2": Settings(
            length_scale=ordinary_length_scale(PAPER_LENGTH_SCALE), epsilon=0.0001
        ),
    }
)
