"""The methods of the paper and one of our own, and what tells them apart."""

from dataclasses import dataclass
from typing import Final

from app.pbbo.errors import UnknownMethodError


@dataclass(frozen=True)
class Method:
    """skip: whether an evaluator may skip.  synthesis: whether a skip becomes preferences.
    model: whether a posterior is kept (the knockout baseline has none).  threshold: whether skips
    and choices also tell of an acceptability threshold, and length scales are averaged."""

    skip: bool
    synthesis: bool
    model: bool
    threshold: bool = False


_METHODS: Final = {
    "pbpo": Method(skip=True, synthesis=True, model=True),
    "pbpo-no-synthesis": Method(skip=True, synthesis=False, model=True),
    "pbpo-no-skip": Method(skip=False, synthesis=False, model=True),
    "knockout": Method(skip=False, synthesis=False, model=False),
    "pbpo-threshold": Method(skip=True, synthesis=False, model=True, threshold=True),
}

METHODS: Final = tuple(_METHODS)


def method_named(name: object) -> Method:
    """The method of this name, or `UnknownMethodError`."""
    if isinstance(name, str) and name in _METHODS:
        return _METHODS[name]
    raise UnknownMethodError(f"method: expected one of {', '.join(METHODS)}, got {name!r}")


def allows_skip(method: str) -> bool:
    """Whether an evaluator may skip under this method."""
    return method_named(method).skip


def has_posterior(method: str) -> bool:
    """Whether this method keeps a model, so that `posterior()` has an answer."""
    return method_named(method).model
