"""A grey ramp that was recorded in any way is the same grey ramp in a browser, once transcoded."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
from playwright.sync_api import Page, Route

from app.video.encoding import transcode

#: Encoders whose pixel formats are all tried, and what their videos are put into. Formats of the
#: others that PyAV has (tried by hand: 330 in all) are decoded to the same ones.
ENCODERS = {"libx264": "mp4", "libx264rgb": "mp4", "mjpeg": "avi", "ffv1": "mkv", "png": "mov"}
#: Black and white alone; a palette that no converter of FFmpeg writes; and what is not video.
NO_RAMP = ("monob", "pal8", "yaf16le", "grayf16le", "gbrpf16le", "gbrpf32le")
#: Without its flag "full range", which this encoder insists on.
REFUSED = {"mjpeg": ("yuv420p", "yuv422p", "yuv444p")}
SIZE = (256, 64)
BARS = np.linspace(0, 255, 16).round().astype(np.uint8)
MOST_APART = 2

#: The middle of each bar of the first frame, as the browser paints it.
READ = """async (url) => {
    const video = document.createElement("video");
    video.muted = true;
    video.src = url;
    await new Promise((resolve, reject) => {
        video.requestVideoFrameCallback(resolve);
        video.onerror = () => reject(new Error(video.error.message));
        video.play();
    });
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
    const context = canvas.getContext("2d");
    context.drawImage(video, 0, 0);
    const bar = canvas.width / BARS;
    return Array.from({ length: BARS }, (_, number) =>
        [...context.getImageData(bar * (number + 0.5), canvas.height / 2, 1, 1).data].slice(0, 3));
}""".replace("BARS", str(len(BARS)))


def ramp() -> av.VideoFrame:
    bars = np.repeat(BARS, SIZE[0] // len(BARS))
    picture = np.repeat(np.tile(bars, (SIZE[1], 1))[:, :, None], 3, axis=2)
    return av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")


def record(path: Path, codec: str, pixel_format: str) -> None:
    """As a program does that hands pictures to PyAV."""
    with av.open(path, "w") as container:
        stream = container.add_stream(codec, rate=10)
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = *SIZE, pixel_format
        stream.codec_context.thread_count = 1
        for number in range(2):
            frame = ramp()
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def pixel_formats(codec: str) -> list[str]:
    left_out = (*NO_RAMP, *REFUSED.get(codec, ()))
    names = [form.name for form in av.Codec(codec, "w").video_formats or []]
    return [name for name in names if name not in left_out]


def test_a_grey_ramp_stays_as_it_was_in_every_pixel_format(page: Page, tmp_path: Path) -> None:
    def answer(route: Route) -> None:
        name = route.request.url.rsplit("/", 1)[1]
        if name:
            route.fulfill(path=tmp_path / name, content_type="video/mp4")
        else:
            route.fulfill(body="<!doctype html>", content_type="text/html")

    page.route("http://videos.example/**", answer)
    page.goto("http://videos.example/")
    apart = {}
    for codec, container in ENCODERS.items():
        for pixel_format in pixel_formats(codec):
            name = f"{codec}-{pixel_format}"
            record(tmp_path / f"{name}.{container}", codec, pixel_format)
            transcode(tmp_path / f"{name}.{container}", tmp_path / f"{name}-new.mp4")
            painted = np.array(page.evaluate(READ, f"http://videos.example/{name}-new.mp4"))
            apart[name] = int(np.abs(painted - BARS[:, None].astype(int)).max())
    assert len(apart) > 80
    assert {name: most for name, most in apart.items() if most > MOST_APART} == {}
