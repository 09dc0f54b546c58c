"""The answer that is a video's file, which may go away at any moment until it is open."""

from __future__ import annotations

from fastapi.responses import FileResponse
from starlette.types import Message, Receive, Scope, Send

from app.services.errors import StoreAwayError


class VideoFile(FileResponse):
    """A file, by ranges. Raises StoreAwayError, with nothing sent yet, if it cannot be opened."""

    # Each piece is read by another thread, which is waited for: most videos are one piece.
    chunk_size = 1024 * 1024

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        head: list[Message] = []
        is_begun = False

        async def send_with_a_piece(message: Message) -> None:
            # The file is opened after its status is told: the two go together.
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
