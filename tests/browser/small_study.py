"""A study of a few small videos that are there at once, for tests that are not about rendering."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import av
import numpy as np

from app.study.folder import SHIPPED
from tests.conftest import write_study

FRAMES_PER_SECOND = 10
SECONDS = 2
HEIGHT_PX, WIDTH_PX = 90, 160
CANDIDATES = 5
RECORDINGS = 3

SMALL_PLAN = """
version: 1
slug: small
title: Small
languages: [en]
parameters: [{name: speed}]
environments:
  kitchen: {source: recordings.csv}
conditions:
  - name: with skip
    method: pbpo
    environment: kitchen
    skip: {label: I don't like either.}
queries_per_trial: 4
break_s: 0
"""

BILINGUAL_PLAN = (
    SMALL_PLAN.replace("languages: [en]", "languages: [en, ja]")
    .replace("title: Small", "title: {en: Small, ja: 小さな調査}")
    .replace("{label: I don't like either.}", "{label: {en: Neither, ja: どちらも良くない}}")
)


def write_small_study(
    folder: Path,
    plan: str = SMALL_PLAN,
    candidates: int = CANDIDATES,
    frames: Sequence[int] = (FRAMES_PER_SECOND * SECONDS,),
    form: str = "mp4",
) -> Path:
    """The folder: candidates of three recordings each, two seconds long.

    frames: numbers of frames of the candidates' videos, in turns. form: mp4 (H.264) or webm (VP9).
    """
    write_study(folder, plan)
    if "languages: [en, ja]" in plan:
        shutil.copytree(SHIPPED["waste-crane"] / "texts" / "ja", folder / "texts" / "ja")
    (folder / "videos").mkdir()
    rows = ["speed,file,score"]
    for candidate in range(candidates):
        for run in range(RECORDINGS):
            name = f"videos/{candidate}-{run}.{form}"
            bar_px = min(15, HEIGHT_PX // candidates)
            _write_video(folder / name, candidate, run, bar_px, frames[candidate % len(frames)])
            rows.append(f"{candidate / 10},{name},{candidate}")
    (folder / "recordings.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


def _write_video(path: Path, candidate: int, run: int, bar_px: int, frames: int) -> None:
    """A bar that moves to the right, lower for each candidate, on a ground of its recording's."""
    with av.open(path, mode="w") as container:
        if path.suffix == ".mp4":
            stream = container.add_stream("libx264", rate=FRAMES_PER_SECOND)
        else:
            stream = container.add_stream("libvpx-vp9", rate=FRAMES_PER_SECOND)
        stream.width, stream.height, stream.pix_fmt = WIDTH_PX, HEIGHT_PX, "yuv420p"
        stream.codec_context.thread_count = 1
        for frame in range(frames):
            picture = np.full((HEIGHT_PX, WIDTH_PX, 3), 200 - 40 * run, dtype=np.uint8)
            top = bar_px * candidate
            picture[top : top + bar_px, 7 * frame : 7 * frame + 20] = 20
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
