"""The response with a video's file, which may be deleted at any moment until it is open."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from fastapi import Request
from fastapi.responses import FileResponse, Response
from starlette.types import Message, Receive, Scope, Send

from app.services.recordings.stores.interface import form_of
from app.services.runtime.errors import StoreAwayError
from app.storage import page_cache

#: Bytes read at a time. Most videos fit into one piece.
PIECE = 1024 * 1024

#: Values of Range that request the whole file: by a page that preloads, and by a player.
_ALL = (None, "bytes=0-")


def answer(file: Path, request: Request, headers: Mapping[str, str]) -> Response:
    """The file, or the requested range of it."""
    content = _one_piece(file) if _is_whole(request) else None
    if content is None:
        return _InPieces(file, media_type=form_of(file.name), headers=headers)
    return _whole(file, content, request, headers)


def answer_from_memory(file: Path, request: Request, headers: Mapping[str, str]) -> Response | None:
    """The whole file if that is requested and the kernel has it in its page cache, otherwise None.

    It waits for no disk, so the event loop may call it. Always None where the system cannot tell.
    """
    content = page_cache.read(file, PIECE) if _is_whole(request) else None
    return None if content is None else _whole(file, content, request, headers)


def _is_whole(request: Request) -> bool:
    """Whether the request is for the whole file."""
    is_plain = request.method == "GET" and "if-range" not in request.headers
    return is_plain and request.headers.get("range") in _ALL


def _whole(file: Path, content: bytes, request: Request, headers: Mapping[str, str]) -> Response:
    form, sent = form_of(file.name), {"Accept-Ranges": "bytes", **headers}
    if "range" not in request.headers:
        return Response(content, 200, sent, form)
    sent["Content-Range"] = f"bytes 0-{len(content) - 1}/{len(content)}"
    return Response(content, 206, sent, form)


def _one_piece(file: Path) -> bytes | None:
    """The content of a file of at most `PIECE` bytes; None if it is longer, empty or missing."""
    try:
        with file.open("rb") as opened:
            content = opened.read(PIECE + 1)
    except OSError:
        return None
    return content if 0 < len(content) <= PIECE else None


class _InPieces(FileResponse):
    """A file, by ranges. Raises StoreAwayError, with nothing sent yet, if it cannot be opened."""

    # Each piece is read in a worker thread.
    chunk_size = PIECE

    def set_stat_headers(self, stat_result: os.stat_result) -> None:
        """The length alone. When a file was written tells in which order candidates were made."""
        self.headers.setdefault("content-length", str(stat_result.st_size))

    def _should_use_range(self, http_if_range: str) -> bool:
        return http_if_range == self.headers["etag"]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        head: list[Message] = []
        is_begun = False

        async def send_with_a_piece(message: Message) -> None:
            # Starlette sends the status before it opens the file: hold it back until then.
            nonlocal is_begun
            if message["type"] == "http.response.start":
                head.append(message)
                return
            is_begun = True
            while head:
                await send(head.pop())
            await send(message)

        try:
            await super().__call__(scope, receive, send_with_a_piece)
        except (OSError, RuntimeError) as error:  # a RuntimeError says that there is no file
            if is_begun:
                raise
            raise StoreAwayError(
                "the video's file went away just now: ask for it again in a moment"
            ) from error
