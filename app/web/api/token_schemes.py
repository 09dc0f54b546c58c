"""The three kinds of token, as `/openapi.json` describes them, and short names of its calls.

What is done about a token stands in `security`: these only describe.
"""

from __future__ import annotations

from fastapi.routing import APIRoute
from fastapi.security import HTTPBearer

SESSION = HTTPBearer(
    scheme_name="session",
    description="A session's token, which was given when it began.",
    auto_error=False,
)
EXPERIMENTER = HTTPBearer(
    scheme_name="experimenter",
    description="An experimenter's API token, made on the page of their account.",
    auto_error=False,
)
MACHINE = HTTPBearer(
    scheme_name="machine",
    description="The token of a machine of the study, which `pbpo machine add` prints once.",
    auto_error=False,
)


def short_id(route: APIRoute) -> str:
    """The name of a call's function, instead of one made of its whole path."""
    return route.name
