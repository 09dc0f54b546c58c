"""Refuses query parameters that a route does not have: a misspelt filter would be ignored."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches

from fastapi import Depends, Request
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError


async def refuse_unknown(request: Request) -> None:
    """Raises RequestValidationError with each parameter that the route does not have."""
    # Asynchronous, because FastAPI runs synchronous dependencies in a thread, at every call.
    if not request.query_params:
        return
    known = list(_names(request.scope["route"].dependant))
    faults = []
    for name in dict.fromkeys(request.query_params):
        if name not in known:
            near = get_close_matches(name, known, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            expected = f"one of {', '.join(sorted(known))}" if known else "no parameter"
            message = f"expected {expected}{hint}"
            faults.append(
                {"type": "extra_forbidden", "loc": ("query", name), "msg": message, "input": name}
            )
    if faults:
        raise RequestValidationError(faults)


def _names(dependant: Dependant) -> Iterator[str]:
    yield from (parameter.alias for parameter in dependant.query_params)
    for inner in dependant.dependencies:
        yield from _names(inner)


KnownParameters = Depends(refuse_unknown)
