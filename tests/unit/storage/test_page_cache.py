"""Files that are read only if no disk has to be waited for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from app.storage import page_cache


def test_a_file_is_read_whole_or_not_at_all(tmp_path: Path) -> None:
    file = tmp_path / "a.mp4"
    file.write_bytes(b"0123456789")
    # Whether the file system can tell what is in memory is its own affair.
    assert page_cache.read(file, 10) in (b"0123456789", None)
    assert page_cache.read(file, 9) is None


def test_a_file_that_is_missing_empty_or_a_folder_is_none(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    for name in ("missing", "empty", "."):
        assert page_cache.read(tmp_path / name, 10) is None


def test_a_part_that_is_in_memory_is_not_taken_for_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "a.mp4"
    file.write_bytes(b"0123456789")
    monkeypatch.setattr(page_cache, "_NOWAIT", 0)
    assert page_cache.read(file, 10) == b"0123456789"
    monkeypatch.setattr(os, "preadv", lambda *_: 4, raising=False)
    assert page_cache.read(file, 10) is None
