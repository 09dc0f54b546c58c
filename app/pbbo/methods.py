"""The methods of the paper and one of our own, and what tells them apart."""

from dataclasses import dataclass
from typing import Final

from .engine import EARLIER_ENGINES, ENGINE_VERSION
from .errors import SkipNotOfferedError, SkipReasonError, UnknownMethodError
from .preferences import Response, SkipReason, checked_reason


@dataclass(frozen=True)
class Method:
    """skip: whether an evaluator may skip.  synthesis: whether a skip becomes preferences.
    model: whether a posterior is kept (the knockout baseline has none).  threshold: whether skips
    and choices also tell of an acceptability threshold, and length scales are averaged."""

    name: str
    skip: bool
    synthesis: bool
    model: bool
    threshold: bool = False

    def understood(self, response: Response, reason: object) -> tuple[Response, SkipReason | None]:
        """A response with its reason, or a named error where this method takes no such thing."""
        if response == "skip" and not self.skip:
            raise SkipNotOfferedError(
                f"response: expected left or right, got skip; {self.name} offers no skip"
            )
        if reason is None:
            return response, None
        if response != "skip":
            raise SkipReasonError(f"reason: expected none for {response}, got {reason!r}")
        if not self.threshold:
            raise SkipReasonError(
                f"reason: expected none, since {self.name} does not learn from it, got {reason!r}"
            )
        return response, checked_reason(reason)


_METHODS: Final = {
    method.name: method
    for method in (
        Method("pbpo", skip=True, synthesis=True, model=True),
        Method("pbpo-no-synthesis", skip=True, synthesis=False, model=True),
        Method("pbpo-no-skip", skip=False, synthesis=False, model=True),
        Method("knockout", skip=False, synthesis=False, model=False),
        Method("pbpo-threshold", skip=True, synthesis=False, model=True, threshold=True),
    )
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


def learns_reasons(method: str, engine_version: str = ENGINE_VERSION) -> bool:
    """Whether this method learns from the reason of a skip, under this version of the engine."""
    return method_named(method).threshold and engine_version not in EARLIER_ENGINES


def has_posterior(method: str) -> bool:
    """Whether this method keeps a model, so that `posterior()` has an answer."""
    return method_named(method).model
