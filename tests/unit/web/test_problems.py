"""Every refusal of a use case is one status, said in one table."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from app.services.runtime import errors
from app.study import stages
from app.web.http import problems


def _all_of(error: type[Exception]) -> Iterator[type[Exception]]:
    for special in error.__subclasses__():
        yield special
        yield from _all_of(special)


@pytest.mark.parametrize(
    "error",
    [*_all_of(errors.ServiceError), *_all_of(stages.ProtocolError)],
    ids=lambda error: error.__name__,
)
def test_every_refusal_has_a_status_and_a_name(error: type[Exception]) -> None:
    assert any(issubclass(error, known) for known, _ in problems.KINDS)


def test_the_special_comes_before_the_general() -> None:
    types = [error for error, _ in problems.KINDS]
    for place, error in enumerate(types):
        assert not any(issubclass(error, earlier) for earlier in types[:place]), error


def test_a_name_means_one_kind_of_refusal() -> None:
    names = [kind.name for _, kind in problems.KINDS]
    assert len(names) == len(set(names))
