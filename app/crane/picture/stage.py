"""The stage: where everything stands in the picture, and how fast it moves.

Lengths are pixels of the finished frame (640 x 360, origin at the top left, y downward). The crane
travels from start to end at constant speed in ten seconds (Sec. V-A).
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.crane.dynamics import DURATION_S, SAMPLE_RATE_HZ

ByteArray: TypeAlias = NDArray[np.uint8]
Color: TypeAlias = tuple[int, int, int]

WIDTH = 640
HEIGHT = 360
FRAME_RATE_HZ = 25
FRAMES = int(DURATION_S * FRAME_RATE_HZ)  # 250: t = 0, 0.04, ... 9.96
SAMPLES_PER_FRAME = SAMPLE_RATE_HZ // FRAME_RATE_HZ
# Everything is drawn this many times larger and averaged down, so that edges are smooth.
SUPERSAMPLE = 2

# Whole pixels per frame: the bucket's picture moves without shimmer, and encodes as pure motion.
TROLLEY_START_X = 66
TROLLEY_PIXELS_PER_FRAME = 2
TROLLEY_SPEED = float(TROLLEY_PIXELS_PER_FRAME * FRAME_RATE_HZ)  # px/s

WALL_FOOT_Y = 316  # where the back wall meets the floor
LANDING_Y = 338  # the line on the floor below the crane
HINGE_Y = 140  # where the claws hang
GRAVITY = 620.0  # px/s^2: a fall from the bucket takes about 0.6 s


def trolley_x(frame: int) -> int:
    """Centre of the trolley in a frame."""
    return TROLLEY_START_X + TROLLEY_PIXELS_PER_FRAME * frame


def trolley_x_at(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of the trolley at any times, px."""
    position: NDArray[np.float64] = TROLLEY_START_X + TROLLEY_SPEED * time
    return position
