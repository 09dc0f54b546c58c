"""The library's videos: named by content, made once, whole or not there."""

from __future__ import annotations

import re
import threading
from pathlib import Path

import pytest

from app.crane import library
from app.crane.dynamics import Run
from app.crane.environments import UnknownEnvironmentError

VIDEO = b"a whole video"


@pytest.fixture
def quick_render(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """A renderer that only writes a few bytes, and notes where."""
    written: list[Path] = []

    def render(run: Run, path: Path) -> None:
        written.append(path)
        path.write_bytes(VIDEO)

    monkeypatch.setattr(library, "render", render)
    return written


def test_a_name_is_the_same_each_time_and_tells_nothing() -> None:
    name = library.video_name("env1", 17, 3)

    assert name == library.video_name("env1", 17, 3)
    assert re.fullmatch(r"[0-9a-f]{32}\.mp4", name)


def test_every_run_has_its_own_name() -> None:
    recordings = [(e, i, k) for e in ("env1", "env2") for i in (5, 80, 230) for k in range(5)]

    assert len({library.video_name(*recording) for recording in recordings}) == len(recordings)


def test_a_new_version_of_the_renderer_gives_new_names(monkeypatch: pytest.MonkeyPatch) -> None:
    before = library.video_name("env2", 5, 0)

    monkeypatch.setattr(library, "RENDERER_VERSION", "another")

    assert library.video_name("env2", 5, 0) != before


@pytest.mark.parametrize(("candidate", "run"), [(-1, 0), (231, 0), (0, -1), (0, 5)])
def test_a_run_the_library_does_not_hold_is_named_in_the_error(candidate: int, run: int) -> None:
    with pytest.raises(library.UnknownRecordingError, match=r"expected a \w+ index from 0 to \d+"):
        library.run("env1", candidate, run)


def test_an_unknown_environment_is_named_in_the_error(tmp_path: Path) -> None:
    with pytest.raises(UnknownEnvironmentError, match="env9"):
        library.ensure_video("env9", 0, 0, tmp_path)


def test_a_video_is_made_once(tmp_path: Path, quick_render: list[Path]) -> None:
    media = tmp_path / "not" / "there" / "yet"

    first = library.ensure_video("env1", 3, 1, media)
    second = library.ensure_video("env1", 3, 1, media)

    assert first == second == media / library.video_name("env1", 3, 1)
    assert first.read_bytes() == VIDEO
    assert len(quick_render) == 1
    assert [path.name for path in media.iterdir()] == [first.name]


def test_a_video_is_never_written_under_its_own_name(
    tmp_path: Path, quick_render: list[Path]
) -> None:
    path = library.ensure_video("env1", 3, 1, tmp_path)

    assert quick_render[0] != path
    assert quick_render[0].suffix != ".mp4"
    assert quick_render[0].parent == path.parent


def test_a_render_that_fails_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def break_down(run: Run, path: Path) -> None:
        path.write_bytes(VIDEO[:4])
        raise OSError("no space left")

    monkeypatch.setattr(library, "render", break_down)

    with pytest.raises(OSError, match="no space left"):
        library.ensure_video("env1", 3, 1, tmp_path)

    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_left_half_written_does_not_count(
    tmp_path: Path, quick_render: list[Path]
) -> None:
    name = library.video_name("env1", 3, 1)
    (tmp_path / f".{Path(name).stem}.0123456789abcdef.part").write_bytes(VIDEO[:4])

    assert library.ensure_video("env1", 3, 1, tmp_path).read_bytes() == VIDEO


def test_two_that_make_the_same_video_at_once_do_no_harm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    both_are_rendering = threading.Barrier(2, timeout=10)
    paths: list[Path] = []

    def render(run: Run, path: Path) -> None:
        path.write_bytes(VIDEO[:4])
        both_are_rendering.wait()
        path.write_bytes(VIDEO)

    monkeypatch.setattr(library, "render", render)
    threads = [
        threading.Thread(target=lambda: paths.append(library.ensure_video("env1", 3, 1, tmp_path)))
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert len(paths) == 2
    assert {path.read_bytes() for path in paths} == {VIDEO}
    assert len(list(tmp_path.iterdir())) == 1
