"""The shipped study, open, with every video in its place: what crowds are let in to."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from app.crane import library
from app.crane.environments import candidates
from app.crane.rendering_jobs import render_these
from app.services.background.local import LocalBackground
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.study.folder import resolve

STUDY = "waste-crane"
ENVIRONMENT = "env1"

#: Videos that are rendered; every other recording has the file of one of them, of the same size.
RENDERED = 24


def make_videos(media_dir: Path) -> None:
    """Every video of the study: a few are rendered, the rest are the same files again."""
    wanted = [(ENVIRONMENT, index, 0) for index in range(0, 24 * 9, 9)][:RENDERED]
    render_these(wanted, media_dir, os.cpu_count() or 1, lambda _done, _all: None)
    rendered = [media_dir / library.video_name(*recording) for recording in wanted]
    for number, name in enumerate(_names()):
        path = media_dir / name
        if not path.exists():
            os.link(rendered[number % len(rendered)], path)


def open_shipped(settings: Settings, folder: Path, **differing: Any) -> None:
    """Open the shipped study as it is, but for its breaks: a crowd that rests measures nothing.

    differing: what else its plan says otherwise.
    """
    source = folder / "study"
    shutil.copytree(resolve(STUDY), source)
    plan = source / "study.yaml"
    changed = yaml.safe_load(plan.read_text(encoding="utf-8")) | {"break_s": 0} | differing
    plan.write_text(yaml.safe_dump(changed, allow_unicode=True), encoding="utf-8")
    app = open_app(settings, background=LocalBackground(1))
    repository.create(app, repository.load_folder(str(source)))
    repository.open_study(app, STUDY)
    app.close()


def _names() -> Iterable[str]:
    for index in range(len(candidates())):
        for run_index in range(library.RUNS_PER_CANDIDATE):
            yield library.video_name(ENVIRONMENT, index, run_index)
