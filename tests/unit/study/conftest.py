"""Builders: a small study folder with real videos, and a plan without a folder."""

from collections.abc import Callable
from pathlib import Path
from typing import cast

import av
import numpy as np
import pytest

from app.study import Plan, StudyFaults, load

FRAMES_PER_SECOND = 5
SIDE_PX = 32

STUDY_YAML = """\
version: 1
slug: kettles
title: Kettles
languages: [en]
parameters:
  - {name: speed, label: Speed, unit: m/s}
  - {name: height}
environments:
  kitchen: {source: recordings.csv}
conditions:
  - name: with skip
    method: pbpo
    environment: kitchen
    skip: {label: Neither}
    settings: {preset: paper-env1}
  - name: without skip
    method: pbpo-no-skip
    environment: kitchen
queries_per_trial: 4
"""

RECORDINGS_CSV = """\
speed,height,file,score
0.1,1,videos/a.mp4,-3.5
0.1,1,videos/b.mp4,
0.2,1,videos/c.mp4,-1e1
"""


def _write_video(
    path: Path, shade: int, *, frames: int = 2, live_format: str | None = None
) -> None:
    """A tiny real video of one shade of grey, so that different shades differ in content.

    live_format: written as a live stream of this form, which does not know its length beforehand.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = np.full((SIDE_PX, SIDE_PX, 3), shade, dtype=np.uint8)
    options = {} if live_format is None else {"live": "1"}
    codec = "libvpx" if live_format == "webm" else "libx264"
    with av.open(path, mode="w", format=live_format, options=options) as container:
        stream = cast("av.VideoStream", container.add_stream(codec, rate=FRAMES_PER_SECOND))
        stream.width, stream.height, stream.pix_fmt = SIDE_PX, SIDE_PX, "yuv420p"
        stream.codec_context.thread_count = 1
        for _ in range(frames):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


@pytest.fixture(scope="session")
def videos(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The bytes of three different videos of 0.4 s: encoded once for all tests."""
    folder = tmp_path_factory.mktemp("videos")
    for shade, name in enumerate(("a", "b", "c")):
        _write_video(folder / f"{name}.mp4", 60 * shade)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture
def folder(tmp_path: Path, videos: dict[str, bytes]) -> Path:
    """A study folder without fault: two conditions, two candidates, three recordings."""
    root = tmp_path / "kettles"
    (root / "videos").mkdir(parents=True)
    (root / "study.yaml").write_text(STUDY_YAML, encoding="utf-8")
    (root / "recordings.csv").write_text(RECORDINGS_CSV, encoding="utf-8")
    for name, content in videos.items():
        (root / "videos" / name).write_bytes(content)
    _write_texts(root, "en")
    return root


def _write_texts(root: Path, language: str) -> None:
    texts = root / "texts" / language
    texts.mkdir(parents=True)
    for name in ("consent", "instructions", "debrief"):
        (texts / f"{name}.md").write_text(f"# The {name} ({language})\n", encoding="utf-8")


def _build_plan(**changes: object) -> Plan:
    """A plan of two conditions with three queries each, changed as a test needs it."""
    data: dict[str, object] = {
        "version": 1,
        "slug": "kettles",
        "title": "Kettles",
        "languages": ["en"],
        "parameters": [{"name": "speed"}],
        "environments": {"kitchen": {"source": "recordings.csv"}},
        "conditions": [
            {"name": "a", "method": "pbpo-no-skip", "environment": "kitchen"},
            {"name": "b", "method": "knockout", "environment": "kitchen"},
        ],
        "queries_per_trial": 3,
    }
    return Plan.model_validate({**data, **changes})


@pytest.fixture(scope="session")
def build_plan() -> Callable[..., Plan]:
    return _build_plan


@pytest.fixture(scope="session")
def write_video() -> Callable[..., None]:
    return _write_video


@pytest.fixture(scope="session")
def write_texts() -> Callable[[Path, str], None]:
    return _write_texts


def _faults(folder: Path) -> list[str]:
    """The faults as the command prints them; none if the folder loads."""
    try:
        load(folder)
    except StudyFaults as error:
        return str(error).splitlines()
    return []


def _edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{old!r} comes {text.count(old)} times"
    file.write_text(text.replace(old, new), encoding="utf-8")


@pytest.fixture(scope="session")
def faults() -> Callable[[Path], list[str]]:
    return _faults


@pytest.fixture(scope="session")
def edit() -> Callable[[Path, str, str], None]:
    return _edit
