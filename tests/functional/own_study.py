"""A study of one's own: a folder with a few real videos, each tiny."""

from __future__ import annotations

import io
from pathlib import Path

import av
import numpy as np
import pytest

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import write_study

OWN_PLAN = """
version: 1
slug: kettles
title: {en: Kettles, ja: やかん}
languages: [en, ja]
parameters:
  - {name: speed, label: Speed, unit: m/s}
  - {name: height}
environments:
  kitchen: {source: recordings.csv}
conditions:
  - name: with skip
    method: pbpo
    environment: kitchen
    skip: {label: {en: Neither, ja: どちらも}}
    settings: {preset: paper-env1, random_queries: 1}
  - {name: last one wins, method: knockout, environment: kitchen}
queries_per_trial: 4
break_s: 0
contact: Jo, jo@lab.example
"""

RECORDINGS = """\
speed,height,file,score
0.1,1,videos/a.mp4,-3.5
0.1,1,videos/b.mp4,
0.2,1,videos/c.mp4,-1e1
0.3,-2,videos/d.mp4,2
"""


def write_own_study(folder: Path, more: str = "") -> Path:
    """The folder, without fault: three candidates, four recordings of 0.4 s.

    more: further lines of its plan.
    """
    write_study(folder, OWN_PLAN + more)
    (folder / "texts" / "ja").mkdir()
    for text in (folder / "texts" / "en").iterdir():
        (folder / "texts" / "ja" / text.name).write_text("日本語の文章。\n", encoding="utf-8")
    (folder / "recordings.csv").write_text(RECORDINGS, encoding="utf-8")
    for shade, name in enumerate("abcd"):
        write_video(folder / "videos" / f"{name}.mp4", 60 * shade)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_own_study(tmp_path_factory.mktemp("own") / "kettles")


@pytest.fixture
def own_study(app: AppContext, folder: Path) -> StudyInfo:
    repository.create(app, repository.load_folder(str(folder)))
    return repository.open_study(app, "kettles")


def frames(video: Path | bytes) -> list[bytes]:
    """The pictures of a video, decoded."""
    opened: Path | io.BytesIO = io.BytesIO(video) if isinstance(video, bytes) else video
    with av.open(opened, mode="r") as container:
        return [frame.to_ndarray().tobytes() for frame in container.decode(video=0)]


def write_video(path: Path, shade: int) -> None:
    path.parent.mkdir(exist_ok=True)
    picture = np.full((32, 32, 3), shade, dtype=np.uint8)
    with av.open(path, mode="w") as container:
        stream = container.add_stream("libx264", rate=5)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        stream.codec_context.thread_count = 1
        for _ in range(2):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
