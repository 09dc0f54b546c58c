"""Forms that bring files: read with a limit, so that nobody fills the disk before being refused."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import Request
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.types import Message

from app.services.draft_files import Sent
from app.services.studio import Studio
from app.services.uploads import MOST_FILES

from .security import check_form_token

#: What surrounds the files in a form, in bytes.
_AROUND = 1_000_000


class TooMuchError(HTTPException):
    """More was sent than a study may take."""

    def __init__(self, limit_mb: int) -> None:
        super().__init__(413, f"Expected at most {limit_mb:,} MB at once")


@asynccontextmanager
async def sent_form(request: Request, studio: Studio) -> AsyncIterator[FormData]:
    """The form with its files, which lie on the disk as long as they are looked at.

    It has to come from our own page: raises ForbiddenError otherwise.

    Raises TooMuchError, by what the browser says of the size or, if that is a lie, by what comes.
    """
    limit_mb = studio.settings.upload_limit_mb
    limit = limit_mb * 1_000_000 + _AROUND
    said = request.headers.get("content-length", "")
    if said.isdecimal() and int(said) > limit:
        raise TooMuchError(limit_mb)
    came = 0

    async def receive() -> Message:
        nonlocal came
        message = await request.receive()
        came += len(message.get("body", b""))
        if came > limit:
            raise TooMuchError(limit_mb)
        return message

    reading = Request(request.scope, receive)
    async with reading.form(max_files=MOST_FILES, max_fields=100) as form:
        check_form_token(request, text_in(form, "csrf_token"))
        yield form


def sent_files(form: FormData, field: str = "files") -> list[Sent]:
    """The files of a field under the names that they had; a field left empty brings none."""
    uploaded = [one for one in form.getlist(field) if isinstance(one, UploadFile)]
    return [Sent(one.filename, one.file) for one in uploaded if one.filename]


def text_in(form: FormData, field: str) -> str:
    value = form.get(field)
    return value if isinstance(value, str) else ""
