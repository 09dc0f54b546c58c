"""The job that makes an ethics bundle, which takes minutes: screenshots of its pages, and the zip.

The files are staged when the bundle is requested, so that it shows the study as it was then. The
zip replaces the study's earlier one.
"""

from __future__ import annotations

import hashlib
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.services.background.job_function import ProgressCallback
from app.services.runtime import private_files
from app.services.runtime.settings import Settings

from . import screenshots

KIND = "ethics"
#: Folder of the pages within the bundle, with a subfolder for each language.
SCREENS = "screens"


def bundle_path(settings: Settings, study_id: int) -> Path:
    """Path of a study's bundle. Study ids are never reused."""
    return folder(settings) / f"{study_id}.zip"


def folder(settings: Settings) -> Path:
    """Folder of the bundles and of staged files."""
    return settings.data_dir / "ethics"


def stage_files(settings: Settings, files: Mapping[str, bytes], account_id: int) -> str:
    """Write the files of a bundle to a staging folder, and return its name.

    The name is derived from the account and the files, so that the same request is one job.
    """
    content = hashlib.sha256()
    for name in sorted(files):
        content.update(name.encode() + b"\0" + hashlib.sha256(files[name]).digest())
    laid = f"{content.hexdigest()[:32]}-{account_id}"
    for name, written in files.items():
        path = folder(settings) / laid / name
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        path.write_bytes(written)
    return laid


def make_bundle(settings: Settings, request: Mapping[str, Any], report: ProgressCallback) -> str:
    """The job handler: zips the staged files with a screenshot of every page."""
    laid = folder(settings) / str(request["laid"])
    target = bundle_path(settings, int(request["study_id"]))
    pages = sorted((laid / SCREENS).rglob("*.html"))
    taken = 0
    for number, page in enumerate(pages):
        report(number, len(pages))
        html = page.read_text(encoding="utf-8")
        picture = screenshots.picture_of(settings, html, is_long=screenshots.is_long(html))
        if picture is not None:
            page.with_suffix(".png").write_bytes(picture)
            taken += 1
    files = sorted(path for path in laid.rglob("*") if path.is_file())
    # Restarted after the bundle was finished.
    if files:
        _zip(laid, files, target)
        shutil.rmtree(laid, ignore_errors=True)
    return f"{len(files)} files, {taken} of them pictures"


def _zip(root: Path, files: list[Path], target: Path) -> None:
    """Write a zip of these files atomically. The same files give the same bytes."""
    part = target.with_name(f"{target.name}.part")
    with (
        private_files.written(part) as file,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for path in files:
            name = path.relative_to(root).as_posix()
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, path.read_bytes())
    part.replace(target)
