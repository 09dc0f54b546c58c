"""One run as a video: the pit, the crane, and the waste that it scatters (Sec. V-A, VII).

All that is seen follows from the run: its opening, its weight and its pieces. The small things no
run records, such as the shape of a piece or where in the gap a straw falls, are drawn from a
generator seeded by the run's own arrays. Nothing names the parameters or the score.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from app.crane.picture.bucket import (
    HOIST_LEFT,
    HOIST_TOP,
    LEFT,
    SHADOW,
    SHADOW_OFFSET,
    TOP,
    claws,
    hoist,
    hoist_shade,
    opening_step,
)
from app.crane.picture.clumps import Clumps
from app.crane.picture.grains import Grains
from app.crane.picture.pit import pit
from app.crane.picture.stage import FRAMES, HINGE_Y, SAMPLES_PER_FRAME, trolley_x

from .dynamics import Run

# Part of every video's name. Raise it when the pictures change, so that old files are not reused.
RENDERER_VERSION = "1"


def fingerprint(run: Run) -> bytes:
    """A digest of all that the picture of a run is made from."""
    digest = hashlib.sha256(run.environment.encode())
    arrays = [run.weight, run.opening]
    if run.pieces is not None:
        arrays += [run.pieces.mass, run.pieces.release_time]
    for array in arrays:
        digest.update(len(array).to_bytes(4, "big"))
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.digest()


def frames(run: Run) -> Iterator[Image.Image]:
    """The 250 pictures of a run, RGBA, in order."""
    rng = np.random.default_rng(int.from_bytes(fingerprint(run)[:16], "big"))
    waste = Grains(run, rng) if run.pieces is None else Clumps(run, rng)
    floor = pit().copy()
    for frame in range(FRAMES):
        trolley = trolley_x(frame)
        room = claws(run.environment, opening_step(run.opening[frame * SAMPLES_PER_FRAME]))
        waste.advance(frame)
        waste.draw_pile(floor)
        canvas = floor.copy()
        corner = (trolley + LEFT, HINGE_Y + TOP)
        hoist_corner = (trolley + HOIST_LEFT, HOIST_TOP)
        _cast_shadow(canvas, hoist_corner, hoist_shade())
        _cast_shadow(canvas, corner, room.shade)
        canvas.paste(room.behind, corner, room.behind)
        waste.draw_held(canvas, room, trolley, frame)
        waste.draw_falling(canvas, frame)
        canvas.paste(room.before, corner, room.before)
        canvas.paste(hoist(), hoist_corner, hoist())
        yield canvas


def _cast_shadow(canvas: Image.Image, corner: tuple[int, int], shade: Image.Image) -> None:
    place = (corner[0] + SHADOW_OFFSET[0], corner[1] + SHADOW_OFFSET[1])
    canvas.paste((*SHADOW, 255), place, shade)


def render(run: Run, path: Path) -> None:
    """Write the video of a run to a path, over whatever is there. The same bytes each time."""
    # The video libraries take 60 ms to load; naming a video, and every command, does without.
    from app.crane.picture.encoding import encode  # noqa: PLC0415

    encode(frames(run), path)
