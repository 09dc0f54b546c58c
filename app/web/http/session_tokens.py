"""The session token of a call: from a header for programs, from a cookie for pages."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Header, Request
from fastapi.concurrency import run_in_threadpool

from app.services.arrival import preview_tokens
from app.services.runtime.errors import SignInRequiredError

from . import session_paths
from .security import app_context_of, bearer


async def session_token(
    request: Request,
    authorization: Annotated[str | None, Header(include_in_schema=False)] = None,
    pbpo_study: Annotated[
        str | None,
        Header(
            description="With a page's cookie instead of a bearer token: the slug of the study."
            " No other site can send this header."
        ),
    ] = None,
) -> str:
    """The session's token. Raises SignInRequiredError, or ForbiddenError for another's preview."""
    token = bearer(authorization)
    if token is not None:
        if not preview_tokens.is_other(app_context_of(request), token):
            await run_in_threadpool(preview_tokens.require_in_force, app_context_of(request), token)
    elif pbpo_study is not None:
        mode, slug = session_paths.of_header(pbpo_study)
        await session_paths.require_admitted(request, mode, slug)
        token = await session_paths.cookie_token(request, mode, slug)
    if token is None:
        raise SignInRequiredError("expected a session's token as `Authorization: Bearer <token>`")
    return token


SessionToken = Annotated[str, Depends(session_token)]
