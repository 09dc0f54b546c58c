"""Making the ethics bundle, a job of minutes: pictures of its pages, and one zip of everything.

What goes into it is laid ready when it is asked for, so that the bundle shows the study as it was
then. The zip takes the place of the study's former one.
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
#: Pages lie in this folder of the bundle, by language.
SCREENS = "screens"


def bundle_path(settings: Settings, study_id: int) -> Path:
    """Where a study's bundle is, once it was made. A study's id never comes again."""
    return folder(settings) / f"{study_id}.zip"


def folder(settings: Settings) -> Path:
    """Where bundles are kept, and what is laid ready for those to come."""
    return settings.data_dir / "ethics"


def stage_files(settings: Settings, files: Mapping[str, bytes], account_id: int) -> str:
    """Keep what the bundle is made of; its name: the same files of one account have the same."""
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
    """The work of a job: the zip of what was laid ready, with a picture of every page."""
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
    # Begun again after it was all but done: the bundle is there.
    if files:
        _zip(laid, files, target)
        shutil.rmtree(laid, ignore_errors=True)
    return f"{len(files)} files, {taken} of them pictures"


def _zip(root: Path, files: list[Path], target: Path) -> None:
    """One zip of these files, whole or not at all: the same files give the same bytes."""
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
