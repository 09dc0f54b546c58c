"""Videos that tests make."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import av
import numpy as np

FRAMES = 30


def write(
    path: Path,
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    size: tuple[int, int] = (64, 48),
    *,
    sound: bool = False,
    frames: int = FRAMES,
    options: dict[str, str] | None = None,
) -> Path:
    """A video of 3 s: a square that wanders over noise, which packs badly."""
    rng = np.random.default_rng(0)
    with av.open(path, "w", options=options or {}) as container:
        stream = cast("av.VideoStream", container.add_stream(codec, rate=10))
        stream.width, stream.height, stream.pix_fmt = *size, pixel_format
        stream.codec_context.thread_count = 1
        voice = container.add_stream("aac", rate=8000) if sound else None
        for index in range(frames):
            picture = rng.integers(0, 255, (size[1], size[0], 3), dtype=np.uint8)
            picture[:8, index : index + 8] = 255
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
        if voice is not None:
            silence = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
            silence.sample_rate = 8000
            container.mux(voice.encode(silence))
            container.mux(voice.encode())
    return path
