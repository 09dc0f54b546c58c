"""`pbpo` with a clock that is some hours ahead of the machine's, or behind it."""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta
from functools import partial

from app import cli
from app.commands import options
from app.services.bootstrap import open_app


def main() -> None:
    ahead = timedelta(hours=float(sys.argv.pop(1)))
    # The clock comes into the studio in this one place.
    options.__dict__["open_app"] = partial(open_app, now=lambda: datetime.now(UTC) + ahead)
    cli.main()


if __name__ == "__main__":
    main()
