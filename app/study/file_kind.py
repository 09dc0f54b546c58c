"""Says what a file is that cannot be played as a video, judged by its first bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

_HEAD_BYTES: Final = 512
_LFS: Final = b"version https://git-lfs.github.com/spec/"
_MARKS: Final = (
    (b"\x89PNG\r\n\x1a\n", "it is a picture (PNG)"),
    (b"\xff\xd8\xff", "it is a picture (JPEG)"),
    (b"BM", "it is a picture (BMP)"),
    (b"PK\x03\x04", "it is a zip or an Office document"),
    (b"%PDF", "it is a PDF"),
    (_LFS, "it is a pointer of Git LFS, not the video: run `git lfs pull` where it comes from"),
    (b"<!doctype html", "it is a web page"),
    (b"<html", "it is a web page"),
)


def kind_of(path: Path) -> str | None:
    """What the file is, as a sentence without its end; None if its first bytes do not tell."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if not head:
        return "it is empty"
    for mark, kind in _MARKS:
        if head.startswith(mark) or (mark.startswith(b"<") and head.lower().startswith(mark)):
            return kind
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return "it is a picture (WebP)"
    try:
        text = head.decode("utf-8")
    except UnicodeDecodeError:
        return None
    return "it is a text" if text.isprintable() or ("\n" in text and "\0" not in text) else None
