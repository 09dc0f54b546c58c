"""Settings of the model of several people, one frozen value."""

from dataclasses import dataclass
from math import isfinite
from typing import Final

from .errors import SettingsError

#: The population keeps at least this share of the variance, so that its best candidate is defined
#: where all taste is each person's own.
LEAST_COMMON: Final = 1e-12


@dataclass(frozen=True)
class PeopleSettings:
    """How the answers of several people are modelled; see docs/optimiser.md, "Several people".

    own_shares: the values of r that are averaged over, from 0 (one taste) to 1 (a taste each).
    own_thresholds: the share of the variance of thresholds and tie widths that is a person's own.
    side_variance: prior variance of a person's inclination to a side, in units of the signal
        variance; 0 for none.
    noises: the noise of a person, as multiples of the average one. The first bounds the weight of
        an answer: nobody's weighs more than 1 / noises[0]^2 times the average person's.
    noise_prior: how likely each of these is beforehand; their sum is taken to be 1.
    exact_answers: up to so many answers every step fits everything afresh.
    unsettled: beyond, so many of the last answers have no part in what is fitted afresh, so that
        steps after different last answers begin from one fit.
    growth: beyond, everything is fitted afresh when the answers have grown by this factor, and
        between only the people who answered since. 1 fits everything at every step.
    summarised_after: between two full fits, the answers so far become a summary whenever there are
        so many more, so that a step fits at most as many people again.
    """

    own_shares: tuple[float, ...] = (0.0, 0.1, 0.25, 0.45, 0.7, 0.95)
    own_thresholds: float = 0.5
    side_variance: float = 0.25
    noises: tuple[float, ...] = (0.7, 1.0, 1.5, 2.5, 5.0, 10.0)
    noise_prior: tuple[float, ...] = (0.25, 0.35, 0.2, 0.08, 0.06, 0.06)
    exact_answers: int = 12
    unsettled: int = 0
    growth: float = 1.15
    summarised_after: int = 8

    def __post_init__(self) -> None:
        for name in ("own_shares", "noises", "noise_prior"):
            given = getattr(self, name)
            if not isinstance(given, (tuple, list)) or not given:
                raise SettingsError(f"{name}: expected one number at least, got {given!r}")
            object.__setattr__(self, name, tuple(number(name, value) for value in given))
        for name in ("own_thresholds", "side_variance", "growth"):
            object.__setattr__(self, name, number(name, getattr(self, name)))
        for name, values in (
            ("own_shares", self.own_shares),
            ("own_thresholds", (self.own_thresholds,)),
        ):
            for value in values:
                if not 0.0 <= value <= 1.0:
                    raise SettingsError(f"{name}: expected a share from 0 to 1, got {value!r}")
        if self.side_variance < 0.0:
            raise SettingsError(
                f"side_variance: expected a number from 0 on, got {self.side_variance!r}"
            )
        if self.noises[0] <= 0.0 or list(self.noises) != sorted(set(self.noises)):
            raise SettingsError(
                f"noises: expected rising numbers above 0, got {list(self.noises)!r}"
            )
        if len(self.noise_prior) != len(self.noises) or min(self.noise_prior) <= 0.0:
            raise SettingsError(
                "noise_prior: expected a number above 0 for each of "
                f"{len(self.noises)} noises, got {list(self.noise_prior)!r}"
            )
        for name, least in (("exact_answers", 0), ("unsettled", 0), ("summarised_after", 1)):
            given = getattr(self, name)
            if not isinstance(given, int) or isinstance(given, bool) or given < least:
                raise SettingsError(
                    f"{name}: expected a whole number from {least} on, got {given!r}"
                )
        if self.growth < 1.0:
            raise SettingsError(f"growth: expected a factor from 1 on, got {self.growth!r}")

    def last_full_fit(self, answers: int) -> int:
        """The number of answers, at most this one, at which everything is fitted afresh."""
        if answers <= self.exact_answers or self.growth == 1.0:
            return answers
        answers = max(answers - self.unsettled, self.exact_answers, 1)
        at = max(self.exact_answers, 1)
        while True:
            after = max(at + 1, int(at * self.growth))
            if after > answers:
                return at
            at = after

    def summaries(self, answers: int) -> range:
        """The numbers of answers after the last full fit, at most this one, at which they become
        a summary."""
        first = self.last_full_fit(answers)
        return range(first + self.summarised_after, answers + 1, self.summarised_after)


def number(name: str, value: object) -> float:
    """A finite number, or `SettingsError`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value):
        raise SettingsError(f"{name}: expected a finite number, got {value!r}")
    return float(value)


def checked_people_settings(people: object) -> PeopleSettings:
    """The settings, by default the usual ones, or `SettingsError`."""
    if people is None:
        return PeopleSettings()
    if not isinstance(people, PeopleSettings):
        raise SettingsError(f"people: expected a PeopleSettings value, got {people!r}")
    return people
