"""Uploads that mean harm, or are broken: refused, with a sentence for everything that is wrong."""

from __future__ import annotations

import io
import stat
import struct
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.drafts import uploads
from app.study.folder import load
from app.study.validation_errors import StudyFaults
from app.video import limits
from tests.videos import write

from .client import Api
from .desk import Desk, zipped
from .own_study import write_own_study


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


def packed(*entries: tuple[str | zipfile.ZipInfo, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return content.getvalue()


def link() -> bytes:
    entry = zipfile.ZipInfo("videos/a.mp4")
    entry.create_system = 3
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return packed((entry, b"/etc/passwd"))


def locked() -> bytes:
    content = bytearray(packed(("study.yaml", b"version: 1")))
    # The mark of a password, in both places in which a zip keeps an entry's marks.
    struct.pack_into("<H", content, 6, 1)
    struct.pack_into("<H", content, content.index(b"PK\x01\x02") + 8, 1)
    return bytes(content)


def truncated() -> bytes:
    return packed(("study.yaml", b"version: 1\n" * 50))[:60]


def corrupt() -> bytes:
    content = bytearray(packed(("study.yaml", bytes(range(256)))))
    content[45] ^= 0xFF
    return bytes(content)


HOSTILE: list[tuple[Callable[[], bytes], str]] = [
    (lambda: packed(("../../study.yaml", b"x")), "leads out of it"),
    (lambda: packed(("/etc/cron.d/x", b"x")), "the absolute"),
    (lambda: packed(("C:/x.yaml", b"x")), "the absolute"),
    (lambda: packed(("videos\\..\\..\\x.mp4", b"x")), "leads out of it"),
    (lambda: packed(("a\u202e.mp4", b"x")), "letters that can be seen"),
    (lambda: packed((".ssh/authorized_keys", b"x")), "hidden"),
    (lambda: packed(("a" * 300, b"x")), "at most 200 characters"),
    (lambda: packed(("A.csv", b"x"), ("a.csv", b"x")), "each file once"),
    (lambda: packed(("a.csv", b"x"), ("a.csv/b.csv", b"x")), "both"),
    (link, "a link"),
    (locked, "without a password"),
    (lambda: packed(("bomb.mp4", bytes(5_000_000))), "pack to no less than 1/200"),
    (packed, "got none"),
    (truncated, "a damaged one"),
    (corrupt, "a damaged one"),
    (lambda: b"no zip", "a damaged one"),
]


@pytest.mark.parametrize(("make", "sentence"), HOSTILE)
def test_a_hostile_zip_is_refused_with_a_sentence_and_leaves_nothing(
    desk: Desk, app: AppContext, make: Callable[[], bytes], sentence: str
) -> None:
    answer = desk.send("/drafts", {"study.zip": make()})
    assert answer.status_code == 422
    assert sentence in answer.text.replace("&#39;", "'")
    assert [path for path in app.settings.uploads_dir.rglob("*") if path.is_file()] == []
    assert "Being made" not in desk.get("/studies").text


def test_everything_that_is_wrong_with_a_zip_is_said_at_once(desk: Desk) -> None:
    answer = desk.send(
        "/drafts", {"study.zip": packed(("../a", b"x"), ("/b", b"x"), ("a\u202e.c", b"x"))}
    )
    assert answer.text.count("<li>Expected") == 3


def test_a_zip_of_too_many_files_is_refused(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "MOST_FILES", 3)
    answer = desk.send("/drafts", {"a.zip": packed(*((f"{n}.csv", b"x") for n in range(4)))})
    assert "at most 3 files" in answer.text


def test_a_refused_upload_leaves_a_draft_as_it_was(desk: Desk) -> None:
    here = desk.begin({"study.zip": packed(("notes.txt", b"first"))})
    bad = packed(("notes.txt", b"second"), ("../x", b"x"))
    assert desk.send(f"{here}/files", {"study.zip": bad}).status_code == 422
    assert "first" in desk.get(f"{here}/text?file=notes.txt").text
    assert desk.send(f"{here}/files", {"../x.csv": b"x"}).status_code == 422
    assert desk.send(f"{here}/files", {}).status_code == 422


def test_what_systems_add_to_a_zip_is_left_out(desk: Desk) -> None:
    entries = (("s/notes.txt", b"x"), ("__MACOSX/s/._notes.txt", b"x"), ("s/.DS_Store", b"x"))
    here = desk.begin({"s.zip": packed(*entries)})
    page = desk.get(here).text
    assert "notes.txt" in page
    assert "MACOSX" not in page
    assert "DS_Store" not in page


def test_a_video_that_the_decoder_does_not_bear_costs_a_sentence_and_the_server_goes_on(
    desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_own_study(tmp_path / "kettles")
    video = folder / "videos" / "c.mp4"
    write(folder / "c.mov", "mjpeg", "yuvj420p", (7000, 7000), frames=1).replace(video)
    monkeypatch.setattr(limits, "PROBING", replace(limits.PROBING, memory_bytes=200_000_000))
    here = desk.begin({"kettles.zip": zipped(folder)})
    page = desk.get(here).text
    assert "1 fault to put right" in page
    said = "decoding it takes more than 200 MB of memory"
    assert said in page
    assert desk.get("/studies").status_code == 200
    # The command says the same of the folder.
    with pytest.raises(StudyFaults, match=said):
        load(folder)
    # It is not tried again each time that somebody looks, but once it was sent again.
    monkeypatch.undo()
    assert said in desk.get(here).text
    assert desk.send(f"{here}/files", {"c.mp4": video.read_bytes()}).status_code == 303
    assert "mjpeg in mp4" in desk.get(here).text


class TestLimits:
    @pytest.fixture(autouse=True)
    def _small(self, app: AppContext) -> None:
        # Settings do not change once read; a test's studio may have others.
        object.__setattr__(app, "settings", app.settings.model_copy(update={"upload_limit_mb": 1}))

    def test_more_than_a_study_may_take_is_refused_before_it_is_read(self, desk: Desk) -> None:
        answer = desk.send("/drafts", {"a.mp4": bytes(2_500_000)})
        assert answer.status_code == 413
        assert "at most 1 MB" in answer.text

    def test_a_body_that_does_not_say_its_size_is_read_no_further(
        self, desk: Desk, client: Api
    ) -> None:
        desk.get("/studies")

        async def endless(httpx_client: object) -> object:
            async def pieces() -> object:
                yield b'--x\r\nContent-Disposition: form-data; name="files"; filename="a"\r\n\r\n'
                for _ in range(100):
                    yield bytes(100_000)

            headers = {"content-type": "multipart/form-data; boundary=x"}
            return await httpx_client.post("/drafts", content=pieces(), headers=headers)  # type: ignore[attr-defined]

        assert client.run(endless).status_code == 413

    def test_a_file_that_does_not_fit_beside_the_others_is_refused(self, desk: Desk) -> None:
        here = desk.begin({"a.mp4": bytes(700_000)}, name="Full")
        answer = desk.send(f"{here}/files", {"b.mp4": bytes(700_000)})
        assert answer.status_code == 422
        assert "b.mp4 is more" in answer.text
        assert "b.mp4" not in desk.get(here).text

    def test_a_zip_that_unpacks_to_more_is_refused(self, desk: Desk) -> None:
        entries = ((f"{n}.txt", b"abc" * 300_000) for n in range(2))
        answer = desk.send("/drafts", {"a.zip": packed(*entries)})
        assert answer.status_code == 422
        assert "unpacked" in answer.text

    def test_a_zip_that_lies_about_its_size_is_stopped_at_the_limit(self, desk: Desk) -> None:
        content = bytearray(packed(("a.txt", b"abc" * 900_000)))
        # The uncompressed size, made to look small in both places.
        struct.pack_into("<I", content, 22, 10)
        struct.pack_into("<I", content, content.index(b"PK\x01\x02") + 24, 10)
        answer = desk.send("/drafts", {"a.zip": bytes(content)})
        assert answer.status_code == 422
