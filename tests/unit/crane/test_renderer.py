"""The video of a run: its form, and that the picture says what the run says and nothing more."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from app.crane import library
from app.crane.dynamics import SAMPLES, Pieces, Run
from app.crane.environments import ENVIRONMENTS, FloatArray
from app.crane.picture.bucket import OPENING_STEPS, claws
from app.crane.picture.pit import pit
from app.crane.picture.stage import FRAMES, HINGE_Y, WALL_FOOT_Y, WIDTH, trolley_x
from app.crane.renderer import fingerprint, frames, render

LARGEST_BYTES = 400_000
RECORDED = (100, 2)  # candidate and run of the library's recordings that are looked at
TIMES = np.linspace(0, 10, SAMPLES)


def grain_run(weight: FloatArray, opening: FloatArray | None = None) -> Run:
    grasp = ENVIRONMENTS["env2"].grasp.weight
    opened = np.full(SAMPLES, 0.3) if opening is None else opening
    return Run("env2", (0.5, 0.5), weight * grasp, opened, None)


def clump_run(release: FloatArray, opening: FloatArray | None = None) -> Run:
    mass = np.full(len(release), ENVIRONMENTS["env1"].grasp.weight / len(release))
    held = (release[:, None] > TIMES) * mass[:, None]
    opened = np.full(SAMPLES, 0.5) if opening is None else opening
    return Run("env1", (0.5, 0.5), held.sum(axis=0), opened, Pieces(mass, release))


def even_run(environment: str) -> Run:
    """Everything falls at a steady pace over the whole way."""
    if environment == "env1":
        return clump_run(np.linspace(0.1, 9.2, 36))
    return grain_run(np.clip(1 - TIMES / 9.5, 0, None))


def dumped_run(environment: str) -> Run:
    """Everything falls within half a second of the start."""
    if environment == "env1":
        return clump_run(np.linspace(0.1, 0.6, 36))
    return grain_run(np.clip(1 - (TIMES - 0.1) / 0.5, 0, 1))


def empty_run(environment: str) -> Run:
    """The same motion with nothing in the bucket."""
    run = even_run(environment)
    if run.pieces is None:
        return replace(run, weight=np.zeros(SAMPLES))
    nothing = Pieces(np.zeros(0), np.zeros(0))
    return replace(run, weight=np.zeros(SAMPLES), pieces=nothing)


def pixels(picture: Image.Image) -> FloatArray:
    return np.asarray(picture.convert("RGB"), dtype=np.float64)


def waste_columns(picture: Image.Image) -> FloatArray:
    """How many points of each column of the floor are not bare. (WIDTH,)."""
    difference = np.abs(pixels(picture) - pixels(pit())).max(axis=2)
    below_the_bucket = WALL_FOOT_Y - 70
    return np.asarray((difference[below_the_bucket:] > 25).sum(axis=0), dtype=np.float64)


@pytest.fixture(scope="module", params=["env1", "env2"])
def video(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / f"{request.param}.mp4"
    render(library.run(request.param, *RECORDED), path)
    return path


def test_a_video_is_ten_seconds_of_h264_that_every_browser_plays(video: Path) -> None:
    with av.open(str(video)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert (stream.codec_context.width, stream.codec_context.height) == (640, 360)
        assert stream.average_rate == 25
        assert stream.start_time == 0
        assert container.duration == 10_000_000
    assert len(pictures) == FRAMES == 250


def test_the_index_comes_before_the_pictures(video: Path) -> None:
    content = video.read_bytes()

    assert 0 < content.index(b"moov") < content.index(b"mdat")


def test_a_video_carries_no_words(video: Path) -> None:
    with av.open(str(video)) as container:
        told = {**container.metadata, **container.streams.video[0].metadata}

    assert not {"title", "comment", "description", "creation_time", "encoder"} & set(told)


def test_the_decoded_pictures_are_the_drawn_ones(video: Path) -> None:
    compared = {0, 1, 124, 249}
    drawn = {
        index: pixels(picture)
        for index, picture in enumerate(frames(library.run(video.stem, *RECORDED)))
        if index in compared
    }
    with av.open(str(video)) as container:
        for index, frame in enumerate(container.decode(video=0)):
            if index in compared:
                decoded = frame.to_ndarray(format="rgb24").astype(np.float64)
                assert np.abs(decoded - drawn[index]).mean() < 4


@pytest.mark.parametrize("environment", ["env1", "env2"])
def test_a_video_is_small_even_when_much_moves(environment: str, tmp_path: Path) -> None:
    # Claws that never rest, over waste that never stops falling, cost the encoder most.
    restless = 0.5 - 0.5 * np.cos(TIMES * 2 * np.pi * 1.5)
    path = tmp_path / "video.mp4"

    render(replace(even_run(environment), opening=restless), path)

    assert path.stat().st_size <= LARGEST_BYTES


def test_the_same_run_gives_the_same_bytes_in_another_process(video: Path, tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path\n"
        "from app.crane import library\n"
        "from app.crane.renderer import render\n"
        "environment, candidate, run, path = sys.argv[1:]\n"
        "render(library.run(environment, int(candidate), int(run)), Path(path))"
    )
    again = tmp_path / "again.mp4"

    arguments = [video.stem, *map(str, RECORDED), str(again)]
    subprocess.run([sys.executable, "-c", script, *arguments], check=True)

    assert again.read_bytes() == video.read_bytes()


@pytest.mark.parametrize("environment", ["env1", "env2"])
def test_the_picture_does_not_depend_on_the_candidate(environment: str) -> None:
    run = even_run(environment)
    other = replace(run, candidate=(0.95, 0.15))

    assert fingerprint(run) == fingerprint(other)
    for mine, theirs in islice(zip(frames(run), frames(other), strict=True), 0, 90, 30):
        assert np.array_equal(pixels(mine), pixels(theirs))


def test_runs_that_differ_in_any_array_have_different_fingerprints() -> None:
    run = clump_run(np.linspace(0.1, 9, 36))
    assert run.pieces is not None
    changed = [
        replace(run, weight=run.weight * 1.01),
        replace(run, opening=run.opening * 0.99),
        replace(run, pieces=Pieces(run.pieces.mass * 1.01, run.pieces.release_time)),
        replace(run, pieces=Pieces(run.pieces.mass, run.pieces.release_time + 0.01)),
        replace(run, environment="env2"),
    ]

    assert len({fingerprint(run), *map(fingerprint, changed)}) == 6


@pytest.mark.parametrize("environment", ["env1", "env2"])
def test_the_gap_between_the_tips_widens_with_the_opening(environment: str) -> None:
    gaps = [claws(environment, step).tip_x for step in range(0, OPENING_STEPS + 1, 8)]

    assert gaps[0] == 0
    assert np.all(np.diff(gaps) > 0)


@pytest.mark.parametrize("environment", ["env1", "env2"])
def test_the_drawn_claws_reach_as_far_as_the_opening_says(environment: str) -> None:
    """The claws' steel, seen against an empty bucket, spreads as the run's opening grows."""
    opening = np.clip(TIMES / 10, 0, 1)
    run = replace(empty_run(environment), opening=opening)
    spreads = []
    for index, picture in enumerate(frames(run)):
        if index % 40 == 0:
            row = np.abs(pixels(picture) - pixels(pit())).max(axis=2)[HINGE_Y + 10]
            steel = np.flatnonzero(row > 60) - trolley_x(index)
            spreads.append(int(steel.max()))

    assert np.all(np.diff(spreads) >= 0)
    assert spreads[-1] > spreads[0] + 8


@pytest.mark.parametrize("environment", ["env1", "env2"])
def test_the_waste_in_the_bucket_shrinks_as_the_weight_falls(environment: str) -> None:
    full, bare = frames(even_run(environment)), frames(empty_run(environment))
    held = []
    for index, (with_waste, without) in enumerate(zip(full, bare, strict=True)):
        if index % 40 == 0:
            difference = np.abs(pixels(with_waste) - pixels(without)).max(axis=2)
            x = trolley_x(index)
            bucket = difference[HINGE_Y - 25 : HINGE_Y + 76, max(x - 80, 0) : x + 80]
            held.append(int((bucket > 25).sum()))

    assert held[0] > 3000
    assert np.all(np.diff(held) < 0)
    assert held[-1] < 0.3 * held[0]


@pytest.mark.parametrize("environment", ["env1", "env2"])
def test_even_scattering_and_a_dump_can_be_told_apart_on_the_floor(environment: str) -> None:
    *_, even = frames(even_run(environment))
    *_, dumped = frames(dumped_run(environment))
    even_columns, dumped_columns = waste_columns(even), waste_columns(dumped)

    assert (even_columns > 3).sum() > 0.6 * WIDTH
    assert (dumped_columns > 3).sum() < 0.4 * WIDTH
    assert dumped_columns.max() > 1.5 * even_columns.max()


def test_more_straw_makes_a_larger_pile() -> None:
    sizes = []
    for share in (0.3, 1.0):
        *_, last = frames(grain_run(np.clip(share * (1 - TIMES / 8), 0, None)))
        sizes.append(float(waste_columns(last).sum()))

    assert 2 * sizes[0] < sizes[1]


@pytest.mark.parametrize("environment", ["env1", "env2"])
def test_waste_that_is_never_let_go_leaves_the_floor_bare(environment: str) -> None:
    held = (
        clump_run(np.full(36, np.inf), np.zeros(SAMPLES))
        if environment == "env1"
        else grain_run(np.ones(SAMPLES), np.zeros(SAMPLES))
    )

    *_, last = frames(held)

    assert waste_columns(last).sum() == 0


def test_the_environments_look_different() -> None:
    clumps, grains = next(frames(even_run("env1"))), next(frames(even_run("env2")))
    x = trolley_x(0)
    bucket = (slice(HINGE_Y, HINGE_Y + 76), slice(x - 60, x + 60))

    assert np.abs(pixels(clumps)[bucket] - pixels(grains)[bucket]).mean() > 20
