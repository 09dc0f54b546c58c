"""One core for one step.

A step works on matrices of a few dozen rows. Split over threads they take longer, and many times
longer where the cores are busy. `app.pbbo` asks for one thread in the environment, which counts
for libraries that load after it; those loaded before, often NumPy itself, are asked here, for as
long as a step takes.
"""

from contextlib import AbstractContextManager
from functools import cache
from typing import Any


@cache
def pools() -> Any:
    """The thread pools loaded by the time of the first step; looking for them takes a while."""
    from threadpoolctl import ThreadpoolController  # noqa: PLC0415

    return ThreadpoolController()


def one_thread() -> AbstractContextManager[Any]:
    """Keeps linear algebra on one thread meanwhile."""
    limit: AbstractContextManager[Any] = pools().limit(limits=1, user_api="blas")
    return limit
