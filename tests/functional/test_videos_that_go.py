"""A video's file, or its folder, goes in the very moment in which somebody asks for it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from pathlib import Path
from typing import Any, TypeVar

import anyio
import httpx
import pytest

from app.crane import library
from app.services.background.interface import Background
from app.services.context import AppContext
from app.services.recordings import recordings
from app.services.recordings.stores.folder import FolderStore
from app.services.runtime.errors import StoreAwayError
from app.services.runtime.settings import Settings
from app.services.studies.repository import StudyInfo
from app.storage import page_cache
from tests.conftest import Idle

from .client import Api
from .own_study import folder, own_study

__all__ = ["folder", "own_study"]

T = TypeVar("T")

AWAY = "urn:pbpo-studio:problem:store-away"


class Here(Idle):
    """What belongs into another process is done at once in this one."""

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        done: Future[T] = Future()
        try:
            done.set_result(function(*args))
        except Exception as error:
            done.set_exception(error)
        return done


@pytest.fixture
def background() -> Background:
    return Here(1)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "data", media_dir=tmp_path / "media")


@pytest.fixture
def url(client: Api, own_study: StudyInfo) -> str:
    return str(client.start("kettles").to_first_query().state["query"]["left"]["url"])


def refused(answer: httpx.Response) -> str:
    assert answer.status_code == 503, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"] == AWAY
    return str(answer.json()["detail"])


@pytest.mark.parametrize(
    ("asked", "moment"),
    [
        ({}, "before it is looked at"),
        ({"Range": "bytes=0-"}, "before it is looked at"),
        ({"Range": "bytes=1-2,5-9"}, "before it is looked at"),
        ({"Range": "bytes=1-2,5-9"}, "before it is opened"),
    ],
)
def test_a_file_that_goes_is_said_to_be_away_and_then_to_be_missing(
    client: Api,
    app: AppContext,
    url: str,
    monkeypatch: pytest.MonkeyPatch,
    asked: dict[str, str],
    moment: str,
) -> None:
    assert client.get(url, headers=asked).status_code == (206 if asked else 200)
    serve, open_file = app.recordings.serve, anyio.open_file

    def gone(path: Any) -> Any:
        Path(path).unlink()
        return path

    with monkeypatch.context() as patch:
        # A file that is in memory is sent from there: this one has to be read from a disk.
        patch.setattr(page_cache, "read", lambda *_: None)
        if moment == "before it is looked at":
            patch.setattr(app.recordings, "serve", lambda *a, **k: gone(serve(*a, **k)))
        else:
            patch.setattr(anyio, "open_file", lambda path, **k: open_file(gone(path), **k))
        assert "ask for it again" in refused(client.get(url, headers=asked))
    assert client.get(url, headers=asked).status_code == 404


def test_a_folder_that_goes_while_a_video_is_made_is_said_to_be_away(
    client: Api, app: AppContext, short_study: StudyInfo, monkeypatch: pytest.MonkeyPatch
) -> None:
    media = app.settings.media_dir

    def render(_run: object, part: Path) -> None:
        part.write_bytes(b"a video")
        if not (media.parent / "came back").exists():
            shutil.rmtree(media)

    monkeypatch.setattr(library, "render", render)
    session = client.start().to_first_query()
    url = session.state["query"]["left"]["url"]
    assert "No such file" in refused(client.get(url))
    (media.parent / "came back").touch()
    assert client.get(url).content == b"a video"


def test_a_folder_that_takes_nothing_is_said_to_be_away(app: AppContext, tmp_path: Path) -> None:
    in_the_way = tmp_path / "a-file"
    in_the_way.touch()
    elsewhere = app.settings.model_copy(update={"media_dir": in_the_way})
    with pytest.raises(StoreAwayError, match=r"the video could not be made: .*exists"):
        recordings.make_video(elsewhere, recordings.crane_locator("env1", 0, 0))
    with pytest.raises(StoreAwayError, match=r"could not be kept: .*exists"):
        FolderStore(in_the_way).put("a.mp4", tmp_path / "a-file")


def test_what_a_full_disk_keeps_half_is_not_left_there(tmp_path: Path) -> None:
    store = FolderStore(tmp_path / "videos")
    with pytest.raises(StoreAwayError):
        store.put("a.mp4", tmp_path / "no-such-file")
    assert list((tmp_path / "videos").iterdir()) == []


def test_what_cannot_be_read_is_said_to_be_away_and_what_is_gone_is_not_there(
    tmp_path: Path,
) -> None:
    store = FolderStore(tmp_path)
    (tmp_path / "a.mp4").write_bytes(b"ab")
    (tmp_path / "folder.mp4").mkdir()
    (tmp_path / "loop.mp4").symlink_to("loop.mp4")
    names = ["a.mp4", "b.mp4", "folder.mp4", "loop.mp4", "a.mp4/within.mp4"]
    assert store.sizes(names) == {"a.mp4": 2}
    assert [store.exists_cached(name) for name in names] == [True, False, False, False, False]
    assert not store.copy_to("b.mp4", tmp_path / "copy.mp4")
    with pytest.raises(StoreAwayError, match="cannot be read: File name too long"):
        store.sizes(["a" * 300])
    assert store.exists_cached("a" * 300) is None
    with pytest.raises(StoreAwayError, match="could not be deleted"):
        store.delete(["a.mp4", "folder.mp4"])
    assert not store.exists_cached("a.mp4")


def test_what_a_power_cut_left_of_a_video_is_kept_anew(tmp_path: Path) -> None:
    """Of 0 bytes, as file systems leave what was never written: it would be there for good."""
    video, kept = tmp_path / "a.mp4", tmp_path / "videos" / "a.mp4"
    video.write_bytes(b"a video")
    store = FolderStore(kept.parent)
    kept.parent.mkdir()
    kept.touch()
    store.put("a.mp4", video)
    assert kept.read_bytes() == b"a video"
    # One that is there is left as it is: somebody may be reading it.
    before = kept.stat()
    store.put("a.mp4", video)
    assert (kept.stat().st_ino, kept.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


def test_a_kept_video_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever sent it throws it away then, and a power cut may come."""
    video, kept = tmp_path / "a.mp4", tmp_path / "videos" / "a.mp4"
    video.write_bytes(b"a video")
    forced: list[tuple[str, bool]] = []
    fsync = os.fsync

    def noted(descriptor: int) -> None:
        fsync(descriptor)
        forced.append((str(Path(f"/proc/self/fd/{descriptor}").readlink()), kept.exists()))

    monkeypatch.setattr(os, "fsync", noted)
    FolderStore(kept.parent).put("a.mp4", video)
    (part, folder) = forced
    assert part[0].startswith(f"{kept}.")
    assert not part[1]
    assert folder == (str(kept.parent), True)
