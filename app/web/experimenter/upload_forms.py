"""Multipart forms with files, checked in order: rights, form token, files.

The form token is the form's first field: no byte of a file is stored before it is checked. Files
are stored on disk, not in memory, and are counted while they are received.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager

from fastapi import Request
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.types import Message

from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.drafts.files import Sent
from app.services.drafts.uploads import UploadRefusedError
from app.services.runtime.errors import ForbiddenError
from app.web.http.security import check_form_token

#: Files in one form. Each is an open file while it comes: a zip may hold more.
MOST_FILES = 500
#: Forms with files of one account that come at the same time, in each process.
MOST_AT_ONCE = 2
#: What surrounds the files in a form, in bytes.
_AROUND = 1_000_000
#: Bytes of a file that stay in memory; a longer one goes to the disk.
_IN_MEMORY = 64_000
_MOST_FIELDS = 20
_LONGEST_FIELD = 10_000
_LONGEST_HEADER = 8_000
#: Bytes read and discarded after a refusal, so that the browser shows it: browsers report a
#: connection closed while they send as a network error.
_DRAINED_BYTES = 100_000_000
_DRAINED_SECONDS = 20.0
_MULTIPART = "multipart/form-data"
_TOO_MANY = "Too many files"

_coming: Counter[int] = Counter()


class TooMuchError(HTTPException):
    """The upload exceeds the size limit of a study."""

    def __init__(self, limit_mb: int) -> None:
        super().__init__(413, f"Expected at most {limit_mb:,} MB at once")


class _Parser(MultiPartParser):
    """A multipart parser that checks the form token before it stores a file, and bounds memory."""

    spool_max_size = _IN_MEMORY

    def __init__(self, request: Request) -> None:
        super().__init__(
            request.headers,
            request.stream(),
            max_files=MOST_FILES,
            max_fields=_MOST_FIELDS,
            max_part_size=_LONGEST_FIELD,
        )
        self._request = request
        self._is_checked = False

    def check(self) -> None:
        """Raises ForbiddenError unless a field before now was the form token."""
        token = next((value for name, value in self.items if name == "csrf_token"), "")
        check_form_token(self._request, token if isinstance(token, str) else "")
        self._is_checked = True

    def on_headers_finished(self) -> None:
        super().on_headers_finished()
        if self._current_part.file is not None and not self._is_checked:
            self.check()

    def on_header_value(self, data: bytes, start: int, end: int) -> None:
        if len(self._current_partial_header_value) + end - start > _LONGEST_HEADER:
            raise MultiPartException("A header of a part is too long.")
        super().on_header_value(data, start, end)

    def on_header_field(self, data: bytes, start: int, end: int) -> None:
        if len(self._current_partial_header_name) + end - start > _LONGEST_HEADER:
            raise MultiPartException("A header of a part is too long.")
        super().on_header_field(data, start, end)


@asynccontextmanager
async def sent_form(
    request: Request, app: AppContext, caller: Principal
) -> AsyncIterator[FormData]:
    """The form with its files, which stay on disk while the context is open.

    Raises ForbiddenError without a valid form token and UploadRefusedError for too many files, both
    before a file is stored. Raises TooMuchError by the Content-Length or, if that is wrong, by the
    bytes received.
    """
    limit_mb = app.settings.upload_limit_mb
    is_multipart = request.headers.get("content-type", "").lower().startswith(_MULTIPART)
    limit = limit_mb * 1_000_000 + _AROUND if is_multipart else _AROUND
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
    with _one_more(caller):
        try:
            form = await _parsed(reading) if is_multipart else await reading.form(max_files=0)
        except (ForbiddenError, UploadRefusedError):
            await drain(reading)
            raise
        try:
            if not is_multipart:
                check_form_token(request, text_in(form, "csrf_token"))
            yield form
        finally:
            await form.close()


async def _parsed(request: Request) -> FormData:
    parser = _Parser(request)
    try:
        form = await parser.parse()
        parser.check()
    except MultiPartException as error:
        if error.message.startswith(_TOO_MANY):
            sentence = (
                f"Expected at most {MOST_FILES} files at once, got more. Put them into a zip, which"
                " may hold more, or send them in several turns."
            )
            raise UploadRefusedError([sentence]) from None
        raise HTTPException(400, error.message) from None
    return form


@contextmanager
def _one_more(caller: Principal) -> Iterator[None]:
    """Count a form being received. Raises HTTPException beyond the limit of an account."""
    if _coming[caller.account_id] >= MOST_AT_ONCE:
        raise HTTPException(
            429,
            f"Expected at most {MOST_AT_ONCE} uploads of an account at a time: wait for one to end",
            {"Retry-After": "10"},
        )
    _coming[caller.account_id] += 1
    try:
        yield
    finally:
        _coming[caller.account_id] -= 1
        if not _coming[caller.account_id]:
            del _coming[caller.account_id]


async def drain(request: Request) -> None:
    """Read and discard the rest of a request, up to a bound."""
    left = _DRAINED_BYTES
    try:
        async with asyncio.timeout(_DRAINED_SECONDS):
            while left > 0:
                message = await request.receive()
                left -= len(message.get("body", b""))
                if message["type"] != "http.request" or not message.get("more_body", False):
                    return
    except TimeoutError:
        return


def sent_files(form: FormData, field: str = "files") -> list[Sent]:
    """The files of a field with their names; an empty field has none."""
    uploaded = [one for one in form.getlist(field) if isinstance(one, UploadFile)]
    return [Sent(one.filename, one.file) for one in uploaded if one.filename]


def text_in(form: FormData, field: str) -> str:
    """The text of a field; empty if the field is missing or is a file."""
    value = form.get(field)
    return value if isinstance(value, str) else ""
