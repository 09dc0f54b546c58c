"""Copies of a study's own videos without metadata: remuxed, the pictures unchanged."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from app.services.runtime.errors import ConflictError
from app.services.runtime.settings import Settings
from app.study.folder import StudyFolder
from app.video.decoder_client import Decoder
from app.video.video_info import UnreadableVideoError

from . import recordings


@contextmanager
def videos(settings: Settings, folder: StudyFolder) -> Iterator[Mapping[str, Path]]:
    """Remux the folder's videos into temporary files, which are deleted when the block ends.

    Yields the path of each copy by the SHA-256 of its source file. The copy's file name is its
    locator. Raises ConflictError if a video cannot be remuxed.
    """
    named = {row.sha256: row.file for row in folder.recordings}
    if not named:
        yield {}
        return
    with (
        tempfile.TemporaryDirectory(prefix="remuxed-", dir=settings.data_dir) as place,
        Decoder() as decoder,
    ):
        made = {}
        for sha256, file in named.items():
            copy = Path(place) / sha256
            try:
                form = decoder.remux(folder.root / file, copy)
            except UnreadableVideoError as error:
                raise ConflictError(
                    f"expected a video whose metadata can be left out, got {file!r}: {error};"
                    " transcode it"
                ) from None
            made[sha256] = copy.rename(copy.with_name(recordings.file_locator(sha256, form)))
        yield made
