"""The job that transcodes the videos of a draft."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.services.background.job_function import ProgressCallback
from app.services.runtime.settings import Settings
from app.study.transcoding import transcode_folder

KIND = "transcode"


def transcode_draft(
    settings: Settings, request: Mapping[str, Any], report: ProgressCallback
) -> str:
    """Transcode the draft's videos that browsers cannot play, and delete the originals.

    request: `draft` is the draft's id. Returns a sentence with the number of videos.
    """
    folder = settings.uploads_dir / "drafts" / str(request["draft"])
    names = transcode_folder(folder, report, keep=False)
    return f"{len(names)} video{'' if len(names) == 1 else 's'} transcoded."
