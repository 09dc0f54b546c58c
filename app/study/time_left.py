"""What is left of a time that was given to somebody, whatever the server's clock does meanwhile."""

from __future__ import annotations

from datetime import datetime

#: By how much a clock may be set back, or two machines' clocks differ, without a word, in seconds.
_CLOCKS_DIFFER_S = 60.0


def seconds_left(given_s: float, ends_at: datetime, now: datetime) -> float:
    """How much is left of `given_s` seconds that end at `ends_at`: 0 once they are over.

    It is never more than was given. Where it would be more by over a minute, the clock was set
    back, by hours perhaps: nobody is to wait until it comes round again, so nothing is left.
    """
    left = (ends_at - now).total_seconds()
    if left > given_s + _CLOCKS_DIFFER_S:
        return 0.0
    return min(max(left, 0.0), given_s)
