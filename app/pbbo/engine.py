"""The version of the optimiser, part of every recorded query.

Raise it whenever the same history and seed may give another query.
"""

from typing import Final

ENGINE_VERSION: Final = "3"
