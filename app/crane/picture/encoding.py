"""Pictures into a video file: H.264 that every browser plays, the same bytes each time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import Interpolation, VideoReformatter
from PIL import Image

from .stage import FRAME_RATE_HZ, HEIGHT, WIDTH

# Near 43 dB at some 0.35 s of CPU. The rate cap and its buffer together bound the file: at most
# 10 s * 260 kbit/s + 0.9 * 500 kbit = 381 KB. No B-frames: pictures come out in their own order,
# so that the first one shows at time 0. One key frame: a video is only ever played from its start.
CODEC_OPTIONS = {
    "preset": "veryfast",
    "crf": "24",
    "maxrate": "260k",
    "bufsize": "500k",
    "g": "250",
    # Finer colour than usual, since grey concrete shows every cast; and a word on how the colours
    # are coded (as the conversion below does it), so that every browser shows the same ones.
    "x264-params": "bframes=0:subme=1:rc-lookahead=10:weightp=0:scenecut=0:chroma-qp-offset=-4"
    ":colorprim=smpte170m:transfer=smpte170m:colormatrix=smpte170m:range=tv",
}
# The index goes first, so that a browser starts before it has the whole file; and no date and no
# library version goes in, so that the same run gives the same bytes.
CONTAINER_OPTIONS = {"movflags": "+faststart", "fflags": "+bitexact"}


def encode(pictures: Iterable[Image.Image], path: Path) -> None:
    """Write RGBA pictures as H.264 (yuv420p) in an MP4 file, over whatever is there."""
    reformatter = VideoReformatter()
    with av.open(str(path), "w", format="mp4", options=CONTAINER_OPTIONS) as container:
        stream = container.add_stream("libx264", rate=FRAME_RATE_HZ, options=CODEC_OPTIONS)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        # Threads change where the encoder cuts its work, and with it the bytes.
        stream.codec_context.thread_count = 1
        for index, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(np.asarray(picture), format="rgba")
            planar = reformatter.reformat(
                frame, format="yuv420p", interpolation=Interpolation.AREA, threads=1
            )
            planar.pts = index
            container.mux(stream.encode(planar))
        container.mux(stream.encode())
