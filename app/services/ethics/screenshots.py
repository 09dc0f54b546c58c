"""Stills of videos, and screenshots of pages by a headless Chromium."""

from __future__ import annotations

import base64
import hashlib
import io
import logging
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageChops

from app.services.runtime.settings import Settings
from app.video.decoder_client import Decoder
from app.video.video_info import UnreadableVideoError

log = logging.getLogger(__name__)

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
_FLAGS = (
    *("--headless", "--disable-gpu", "--hide-scrollbars", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)

#: Size of a laptop's window. Pages of text get more height, and empty space below is cropped.
WIDTH, HEIGHT = 1280, 800
LONG_HEIGHT = 4000
_MARGIN = 32

#: Timeout of one screenshot in seconds, long enough for a busy machine.
_PATIENCE_S = 60


def browser(settings: Settings) -> str | None:
    """Path of the Chromium for screenshots; None if there is none."""
    named = settings.chromium
    return next(
        (path for name in ([named] if named else _BROWSERS) if (path := shutil.which(name))), None
    )


def stills(videos: Sequence[Path | None]) -> list[str | None]:
    """A frame from the middle of each video, as a data URL.

    None for a missing video and for one that cannot be read.
    """
    with Decoder() as decoder:
        return [None if video is None else _still(decoder, video) for video in videos]


def _still(decoder: Decoder, video: Path) -> str | None:
    try:
        picture = decoder.still(video)
    except UnreadableVideoError:
        log.exception("no still of the video %s", video.name)
        return None
    return f"data:image/jpeg;base64,{base64.b64encode(picture).decode('ascii')}"


def is_long(html: str) -> bool:
    """Whether a page may be taller than the window; pages with videos fit into it."""
    return '<main class="query"' not in html


def picture_of(settings: Settings, html: str, *, is_long: bool = True) -> bytes | None:
    """A screenshot of the page as PNG; None without a browser, or after the timeout.

    is_long: whether the page may be taller than the window. Screenshots are cached in the data
    folder by the page's content.
    """
    executable = browser(settings)
    if executable is None:
        return None
    kept = settings.data_dir / "screens" / f"{hashlib.sha256(html.encode()).hexdigest()}.png"
    if not kept.exists():
        taken = _take(executable, html, LONG_HEIGHT if is_long else HEIGHT)
        if taken is None:
            return None
        kept.parent.mkdir(mode=0o700, exist_ok=True)
        part = kept.with_suffix(f".{os.getpid()}.part")
        part.write_bytes(taken)
        part.replace(kept)
    return kept.read_bytes()


def _take(executable: str, html: str, height: int) -> bytes | None:
    with tempfile.TemporaryDirectory(prefix="pbpo-screen-") as name:
        folder = Path(name)
        page, picture = folder / "page.html", folder / "page.png"
        page.write_text(html, encoding="utf-8")
        words = [
            executable,
            *_FLAGS,
            # The sandbox does not work as root. The page is our own and contains no script.
            *(["--no-sandbox"] if os.geteuid() == 0 else []),
            f"--user-data-dir={folder / 'profile'}",
            f"--window-size={WIDTH},{height}",
            f"--screenshot={picture}",
            page.as_uri(),
        ]
        try:
            subprocess.run(  # noqa: S603 - the server's own settings name the browser
                words, check=True, capture_output=True, timeout=_PATIENCE_S
            )
        except (OSError, subprocess.SubprocessError):
            return None
        return _cut(picture) if picture.exists() else None


def _cut(path: Path) -> bytes:
    """Crop the empty space at the bottom of the picture, and return it as PNG."""
    with Image.open(path) as opened:
        picture = opened.convert("RGB")
    ground = Image.new("RGB", picture.size, picture.getpixel((0, picture.height - 1)))
    box = ImageChops.difference(picture, ground).getbbox()
    bottom = min(picture.height, max(HEIGHT, (box[3] if box else 0) + _MARGIN))
    sink = io.BytesIO()
    picture.crop((0, 0, picture.width, bottom)).save(sink, "PNG", optimize=True)
    return sink.getvalue()
