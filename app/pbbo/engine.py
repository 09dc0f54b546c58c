"""The version of the optimiser, part of every recorded query.

Raise it whenever the same history and seed may give another query.
"""

from typing import Final

ENGINE_VERSION: Final = "4"
# Before version 3 the threshold method had other defaults, and took every skip for "both are bad".
EARLIER_ENGINES: Final = ("1", "2")
# Before version 4 a model of several people fitted older answers in another way between full fits.
EARLIER_PEOPLE_ENGINES: Final = (*EARLIER_ENGINES, "3")
