"""The example of docs/machines.md, as a machine: a simulator of others makes a video on demand."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import av
import numpy as np

from .fake_studio import FakeStudio

ROOT = Path(__file__).parents[3]
PROGRAM = ROOT / "static" / "machine" / "pbpo_machine.py"
DRIVER = ROOT / "docs" / "examples" / "highway_driver.py"


def test_the_motorway_simulator_records_a_moving_picture_for_a_rollout(tmp_path: Path) -> None:
    studio = FakeStudio()
    try:
        studio.ask("r1", gap=1.5, politeness=0.2, acceleration=3.0)
        connect = [PROGRAM, "--url", studio.url, "--study", "crane", "--token", "secret", "--once"]
        words = ["--gap", "{gap}", "--politeness", "{politeness}", "--acceleration"]
        words += ["{acceleration}", "--seed", "{seed}", "--seconds", "1", "--out", "{video}"]
        command = [sys.executable, *connect, "--", sys.executable, DRIVER, *words]
        done = subprocess.run(
            [str(word) for word in command], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert list(studio.videos) == ["r1"], done.stdout + done.stderr
        video = tmp_path / "recording.mp4"
        video.write_bytes(studio.videos["r1"])
    finally:
        studio.close()
    with av.open(video) as file:
        pictures = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    assert len(pictures) == 15
    assert pictures[0].shape == (180, 640, 3)
    assert pictures[0].std() > 10  # a road with cars, and not one colour
    assert np.abs(pictures[0].astype(int) - pictures[-1]).mean() > 1
