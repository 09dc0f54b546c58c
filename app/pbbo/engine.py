"""The version of the optimiser, part of every recorded query.

Raise it whenever the same history and seed may give another query.
"""

from typing import Final

ENGINE_VERSION: Final = "3"
# Before version 3 the threshold method had other defaults, and took every skip for "both are bad".
EARLIER_ENGINES: Final = ("1", "2")
