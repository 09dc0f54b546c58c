"""The path below which the studio is served (PBPO_ROOT_PATH): off requests, onto responses.

Within the application addresses have no such path. Requests may come with it, from a proxy that
passes them on as they are, or without it, from one that strips it. It is put on redirects and on
the paths of cookies here, on links by the templates, and on public links by `public_address`.
"""

from __future__ import annotations

from fastapi import FastAPI
from fastapi.routing import iter_route_contexts
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.services.runtime.settings import Settings


class RootPath:
    """Serves the application below the path of its settings; nothing is done without one."""

    def __init__(self, asgi_app: ASGIApp) -> None:
        self._app = asgi_app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        app: AppContext = scope["app"].state.app
        root = app.settings.root_path
        if scope["type"] != "http" or not root:
            await self._app(scope, receive, send)
            return

        async def send_below(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if headers.get("location", "").startswith("/"):
                    headers["location"] = f"{root}{headers['location']}"
            await send(message)

        scope["path"] = _without(scope["path"], root)
        if (raw := scope.get("raw_path")) is not None:
            scope["raw_path"] = _without(raw.decode("latin-1"), root).encode("latin-1")
        await self._app(scope, receive, send_below)


def _without(path: str, root: str) -> str:
    if path == root or path.startswith(f"{root}/"):
        return path[len(root) :] or "/"
    return path


def require_unambiguous(fastapi_app: FastAPI, settings: Settings) -> None:
    """Raises ConflictError if the path begins as an address of the studio does.

    `/studies/...` would then be an address with the path, and one from which it was stripped.
    """
    first = settings.root_path.split("/")[1:2]
    contexts = iter_route_contexts(fastapi_app.routes)
    own = {context.path.split("/")[1] for context in contexts if context.path}
    if own.intersection(first):
        raise ConflictError(
            "PBPO_ROOT_PATH: expected a path that begins otherwise than the studio's own addresses"
            f" ({', '.join(sorted(name for name in own if name))}), got {settings.root_path!r}"
        )
