"""Computes the time left of a period, robust against changes of the server's clock."""

from __future__ import annotations

from datetime import datetime

#: Tolerated difference of clocks, in seconds: set back, or between two machines.
_CLOCKS_DIFFER_S = 60.0


def seconds_left(given_s: float, ends_at: datetime, now: datetime) -> float:
    """The rest of a period of `given_s` seconds that ends at `ends_at`; 0 once it is over.

    It is never more than `given_s`. If the clock implies over a minute more, it was set back,
    perhaps by hours: the result is 0, so that no one waits for it to catch up.
    """
    left = (ends_at - now).total_seconds()
    if left > given_s + _CLOCKS_DIFFER_S:
        return 0.0
    return min(max(left, 0.0), given_s)
