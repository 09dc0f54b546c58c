"""No body is longer than what anybody can mean, whatever it says of itself."""

from __future__ import annotations

import re

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: A million characters of a study's text, each as nine in a form, is the longest that is sent.
LONGEST_BODY = 10_000_000

#: Forms that bring files count for themselves what comes, by a limit of their own.
_WITH_FILES = re.compile(r"/drafts(/[^/]+/files)?")


class BodyLimit:
    """Ends the reading of a body that is too long with 413, before it fills the memory."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or _WITH_FILES.fullmatch(scope["path"]):
            await self._app(scope, receive, send)
            return
        said = Headers(scope=scope).get("content-length", "")
        came = int(said) if said.isdecimal() else 0
        is_counted = came == 0

        async def limited() -> Message:
            nonlocal came
            if came > LONGEST_BODY:
                raise HTTPException(413, f"Expected at most {LONGEST_BODY:,} bytes")
            message = await receive()
            if is_counted:
                came += len(message.get("body", b""))
                if came > LONGEST_BODY:
                    raise HTTPException(413, f"Expected at most {LONGEST_BODY:,} bytes")
            return message

        await self._app(scope, limited, send)
