"""Retention: the plan's rule, and what is due for deletion by it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta

from pydantic import Field, StrictInt

from .parsed_plan import Inconsistency, as_mapping
from .plan_model import Part

_DAYS = "a whole number of days from 1 to 36500"


class Retention(Part):
    """Days after a session's end, or its expiry, that identities and everything are kept for."""

    identity_days: StrictInt | None = Field(default=None, ge=1, le=36_500, description=_DAYS)
    everything_days: StrictInt | None = Field(default=None, ge=1, le=36_500, description=_DAYS)

    @property
    def identities_kept_for(self) -> int | None:
        """Days that ids of platforms are kept for; None: until they are deleted on request."""
        return self.identity_days or self.everything_days


@dataclass(frozen=True)
class Due:
    """What is due for deletion: the identifiers, or the whole session."""

    identities: bool
    everything: bool


def due(rule: Retention, ended_at: datetime | None, expires_at: datetime, now: datetime) -> Due:
    """What is due for deletion at `now`; days count from the session's end, or else its expiry."""
    over_since = expires_at if ended_at is None else ended_at

    def passed(days: int | None) -> bool:
        return days is not None and now >= over_since + timedelta(days=days)

    return Due(passed(rule.identities_kept_for), passed(rule.everything_days))


def disagreements(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """Contradictions within the plan's `retention`, given as plain data."""
    said = as_mapping(plan.get("retention"))
    identities, everything = said.get("identity_days"), said.get("everything_days")
    if isinstance(identities, int) and isinstance(everything, int) and identities > everything:
        message = f"expected at most everything_days ({everything}), got {identities}"
        yield Inconsistency(("retention", "identity_days"), message)
