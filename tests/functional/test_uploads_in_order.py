"""Of an upload nothing is kept before rights and form token, and little of it in memory."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from starlette.datastructures import UploadFile

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.web.experimenter import upload_forms

from .client import Api
from .desk import Desk

FILES, MEGABYTE = 300, 1_000_000
#: In bytes, beyond what it was: 300 files would be 300 MB.
MOST_GROWTH = 60_000_000


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"upload_limit_mb": 400})


class Watched:
    """The most memory that this process had while something was done."""

    def __enter__(self) -> Watched:
        self._stop = threading.Event()
        self._before = self._most = self._now()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    @property
    def growth(self) -> int:
        return self._most - self._before

    def _watch(self) -> None:
        while not self._stop.is_set():
            self._most = max(self._most, self._now())
            time.sleep(0.005)

    @staticmethod
    def _now() -> int:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")


class Body:
    """A form of so many files, as a browser sends it; counts what was asked for of it."""

    def __init__(self, token: str, *, files: int = FILES, token_first: bool = True) -> None:
        self._token, self._files, self._first = token, files, token_first
        self.sent = 0

    async def __aiter__(self) -> AsyncIterator[bytes]:
        field = b'--x\r\nContent-Disposition: form-data; name="csrf_token"\r\n\r\n%s\r\n'
        token = field % self._token.encode()
        if self._first:
            yield token
        piece = bytes(MEGABYTE // 10)
        for number in range(self._files):
            yield (
                b'--x\r\nContent-Disposition: form-data; name="files"; filename="%d.mp4"\r\n\r\n'
                % number
            )
            for _ in range(10):
                self.sent += len(piece)
                yield piece
            yield b"\r\n"
        if not self._first:
            yield token
        yield b"--x--\r\n"

    def send(self, desk: Desk, path: str) -> int:
        desk.get("/studies")
        headers = {"content-type": "multipart/form-data; boundary=x"}
        return desk.client.post(path, content=self, headers=headers).status_code


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many bytes of files were kept, piece by piece."""
    pieces: list[int] = []
    write = UploadFile.write

    async def counted(file: UploadFile, data: bytes) -> None:
        pieces.append(len(data))
        await write(file, data)

    monkeypatch.setattr(UploadFile, "write", counted)
    return pieces


def files_in(app: AppContext) -> list[Path]:
    return [path for path in app.settings.uploads_dir.rglob("*") if path.is_file()]


@pytest.mark.sqlite
def test_three_hundred_files_take_little_memory(desk: Desk) -> None:
    with Watched() as memory:
        assert Body(desk.csrf).send(desk, "/drafts") == 303
    assert memory.growth < MOST_GROWTH


@pytest.mark.parametrize("token", ["wrong", ""])
def test_with_a_wrong_token_nothing_is_kept(
    desk: Desk, app: AppContext, kept: list[int], token: str
) -> None:
    with Watched() as memory:
        assert Body(token).send(desk, "/drafts") == 403
    assert memory.growth < MOST_GROWTH
    assert not any(kept)
    assert files_in(app) == []


def test_a_token_behind_the_files_is_too_late(desk: Desk, kept: list[int]) -> None:
    assert Body(desk.csrf, files=3, token_first=False).send(desk, "/drafts") == 403
    assert not any(kept)


def test_a_reviewer_sends_nothing(client: Api, app: AppContext, kept: list[int]) -> None:
    reviewer = Desk(client, app, "rev@lab.example", Role.REVIEWER)
    body = Body(reviewer.csrf)
    assert body.send(reviewer, "/drafts") == 403
    assert kept == []
    # Not even all of it was let come.
    assert body.sent < upload_forms._DRAINED_BYTES + 2 * MEGABYTE


def test_nobody_adds_files_to_a_draft_of_somebody_else(
    desk: Desk, client: Api, app: AppContext, kept: list[int]
) -> None:
    here = desk.begin({}, name="Mine")
    other = Desk(client, app, "other@lab.example", Role.ADMIN)
    kept.clear()
    assert Body(other.csrf, files=3).send(other, f"{here}/files") == 404
    assert kept == []
    desk.client.cookies.clear()
    assert client.post(f"{here}/files", content=b"x").status_code in (303, 422)


def test_a_form_takes_500_files_and_says_what_to_do_with_more(desk: Desk, app: AppContext) -> None:
    files = {f"{number}.txt": b"x" for number in range(upload_forms.MOST_FILES + 1)}
    answer = desk.send("/drafts", files)
    assert answer.status_code == 422
    assert "at most 500 files at once" in answer.text
    assert "Put them into a zip" in answer.text
    assert files_in(app) == []
    files.popitem()
    assert desk.send("/drafts", files).status_code == 303


@pytest.mark.parametrize(
    "body",
    [
        b"--x\r\n" + b"a" * 200_000 + b": b\r\n\r\n\r\n--x--\r\n",
        b"--x\r\nContent-Disposition: " + b"a" * 200_000 + b"\r\n\r\n\r\n--x--\r\n",
        b'--x\r\nContent-Disposition: form-data; name="name"\r\n\r\n' + b"a" * 200_000,
        b'--x\r\nContent-Disposition: form-data; name="n"\r\n\r\nx\r\n' * 200 + b"--x--\r\n",
    ],
)
def test_what_surrounds_files_is_bounded(desk: Desk, body: bytes) -> None:
    desk.get("/studies")
    headers = {"content-type": "multipart/form-data; boundary=x"}
    assert desk.client.post("/drafts", content=body, headers=headers).status_code == 400


def test_a_form_without_files_is_no_way_round_the_limits(desk: Desk) -> None:
    desk.get("/studies")
    headers = {"content-type": "application/x-www-form-urlencoded"}
    body = f"csrf_token={desk.csrf}&name=".encode() + b"a" * 2_000_000
    assert desk.client.post("/drafts", content=body, headers=headers).status_code == 413


def test_an_account_sends_two_forms_at_a_time(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(upload_forms._coming, desk.account.account_id, upload_forms.MOST_AT_ONCE)
    answer = desk.send("/drafts", {"a.txt": b"x"})
    assert (answer.status_code, "at a time" in answer.text) == (429, True)
    upload_forms._coming.clear()
    assert desk.send("/drafts", {"a.txt": b"x"}).status_code == 303
    assert not upload_forms._coming
