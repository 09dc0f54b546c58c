"""Shredded paper and packing: clumps that wait in the bucket, fall, and come to rest (Env1).

Each piece of the run is one clump. The held ones lie in the order in which they will fall, the next
at the mouth, and sink as those below them go. A falling clump keeps the trolley's speed, lands
where it falls, and rolls a little way if the heap beside it is lower.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

from app.crane.dynamics import Run
from app.crane.environments import FloatArray, environment_named

from .bucket import Claws, claws, opening_step
from .scraps import Scrap, scrap
from .stage import (
    FRAME_RATE_HZ,
    GRAVITY,
    HINGE_Y,
    LANDING_Y,
    SAMPLES_PER_FRAME,
    TROLLEY_SPEED,
    WIDTH,
    trolley_x,
)

HELD_AREA = 5300.0  # px^2 of the bucket that a grasp of the mean weight fills
PILE_AREA = 12000.0  # px^2 of clumps that the same grasp is: they are squeezed in the bucket
# Clumps lie into each other: a layer of them is this much of its clumps' area high.
PACKING = 0.62
CLING_HEIGHT = 34.0  # px above the tips below which clumps hang on the tines
SINK_RATE = 0.3  # share of the way to its place that a held clump sinks per frame
GOLDEN = 0.6180339887  # spreads successive clumps across the bucket without a pattern
THROUGH_MOUTH_S = 0.14  # a clump reaches the gap between the tips within this time
ROLL_S = 0.2  # from touching down to rest
DEPTH_SPREAD = 7.0  # px; clumps land nearer to or farther from the camera


@dataclass
class Fall:
    """One clump on its way from the bucket to its rest."""

    piece: int
    released: float  # s
    start_x: float  # px, in the frame
    start_y: float
    shift_x: float  # px sideways that bring it through the gap
    speed_x: float  # px/s
    spin: float  # rad/s
    landed: float = math.inf  # s
    land_x: float = 0.0
    land_y: float = 0.0
    rest_x: float = 0.0
    rest_y: float = 0.0

    def place(self, now: float) -> tuple[float, float]:
        """Where the clump is in the air."""
        since = now - self.released
        eased = min(since / THROUGH_MOUTH_S, 1.0)
        x = self.start_x + self.speed_x * since + self.shift_x * eased * eased * (3 - 2 * eased)
        return x, self.start_y + 0.5 * GRAVITY * since * since

    def rolling(self, now: float) -> tuple[float, float]:
        """Where the clump is between touching down and rest."""
        share = min((now - self.landed) / ROLL_S, 1.0)
        eased = share * (2 - share)
        x = self.land_x + (self.rest_x - self.land_x) * eased
        return x, self.land_y + (self.rest_y - self.land_y) * eased


class Clumps:
    """The clumps of one run, frame by frame."""

    def __init__(self, run: Run, rng: np.random.Generator) -> None:
        assert run.pieces is not None
        mean_weight = environment_named(run.environment).grasp.weight
        self._share = run.pieces.mass / mean_weight  # (p,)
        self._release = run.pieces.release_time  # (p,) s
        self._opening = run.opening
        self._environment = run.environment
        count = len(self._share)
        self._scraps: list[Scrap] = [
            scrap(math.sqrt(float(share) * PILE_AREA / math.pi), rng) for share in self._share
        ]
        self._order = np.argsort(self._release, kind="stable")  # next to fall first
        self._across = 2 * ((np.arange(count) * GOLDEN + rng.uniform()) % 1.0) - 1  # (p,) by order
        self._angle = rng.uniform(0, 2 * math.pi, count)
        self._spin = rng.normal(0, 3.2, count)
        self._drift = rng.normal(0, 7, count)
        self._depth = rng.uniform(-1, 1, count) * DEPTH_SPREAD
        self._lift = self._settled_areas(0)  # (p,) px^2 below each held clump, by order
        self._gone = 0  # clumps up to here, by order, have left the bucket
        self._falls: list[Fall] = []
        self._resting: list[Fall] = []
        self._height = np.zeros(WIDTH)

    def _settled_areas(self, gone: int) -> FloatArray:
        """Area below the middle of each clump in the bucket when the first ``gone`` have left."""
        area = self._share[self._order] * HELD_AREA
        area[:gone] = 0
        below: FloatArray = np.cumsum(area) - area / 2
        return below

    def _held_place(self, rank: int, room: Claws) -> tuple[float, float]:
        """Where the clump of a rank lies, relative to the bucket."""
        radius = self._scraps[self._order[rank]].radius
        y = float(room.level(self._lift[rank]))
        spare = max(float(room.half_width_at(y)) - radius * 0.75, 0.0)
        x = float(self._across[rank]) * spare
        # Over an open mouth the waste hangs on the tines: nothing floats between the tips.
        near = min(max((y - room.tip_y + CLING_HEIGHT) / CLING_HEIGHT, 0.0), 1.0)
        hanging = max(room.tip_x - radius * 0.3, 0.0) * near
        if abs(x) < hanging:
            x = math.copysign(hanging, x)
        return x, min(y, room.tip_y - radius * 0.6)

    def advance(self, frame: int) -> None:
        """Let clumps leave, fall and come to rest up to a frame's time."""
        now = frame / FRAME_RATE_HZ
        trolley = trolley_x(frame)
        room = claws(
            self._environment, opening_step(float(self._opening[frame * SAMPLES_PER_FRAME]))
        )
        ordered = self._release[self._order]
        while self._gone < len(ordered) and ordered[self._gone] <= now:
            self._let_go(self._gone, room, trolley, now)
            self._gone += 1
        target = self._settled_areas(self._gone)
        self._lift += (target - self._lift) * SINK_RATE
        for fall in self._falls:
            self._land(fall, now)
        done = [fall for fall in self._falls if now >= fall.landed + ROLL_S]
        self._resting += done
        self._falls = [fall for fall in self._falls if now < fall.landed + ROLL_S]

    def _let_go(self, rank: int, room: Claws, trolley: int, now: float) -> None:
        piece = int(self._order[rank])
        x, y = self._held_place(rank, room)
        through = max(room.tip_x - self._scraps[piece].radius * 0.5, 2.0)
        released = float(self._release[piece])
        self._falls.append(
            Fall(
                piece=piece,
                released=released,
                start_x=trolley - TROLLEY_SPEED * (now - released) + x,
                start_y=HINGE_Y + y,
                shift_x=min(max(x, -through), through) - x,
                speed_x=TROLLEY_SPEED + float(self._drift[piece]),
                spin=float(self._spin[piece]),
            )
        )

    def _land(self, fall: Fall, now: float) -> None:
        if fall.landed <= now:
            return
        radius = self._scraps[fall.piece].radius
        x, y = fall.place(now)
        depth = float(self._depth[fall.piece])
        if y < LANDING_Y + depth - self._mean_height(x, radius) - radius * 0.7:
            return
        fall.landed = now
        fall.land_x, fall.land_y = x, y
        # It rolls to the lowest place within its reach, unless that is hardly lower.
        reach = radius * 1.7
        places = np.linspace(x - reach, x + reach, 9)
        heights = [
            self._mean_height(float(place), radius) + 0.25 * abs(float(place) - x)
            for place in places
        ]
        fall.rest_x = float(places[int(np.argmin(heights))])
        under = self._mean_height(fall.rest_x, radius)
        fall.rest_y = LANDING_Y + depth - under - radius * 0.7
        fall.land_y = min(fall.land_y, fall.rest_y)
        self._pile_up(fall.rest_x, radius)

    def _mean_height(self, x: float, radius: float) -> float:
        left = min(max(int(x - radius), 0), WIDTH - 2)
        right = min(max(int(x + radius) + 1, left + 1), WIDTH)
        return float(self._height[left:right].mean())

    def _pile_up(self, x: float, radius: float) -> None:
        """Add a clump to the heap's profile: a bump of its area, somewhat wider than itself."""
        spread = 1.25 * radius
        bump = np.clip(1 - ((np.arange(WIDTH) + 0.5 - x) / spread) ** 2, 0, None)
        area = math.pi * radius * radius * PACKING
        self._height += bump * (area / max(float(bump.sum()), 1.0))

    def draw_pile(self, floor: Image.Image) -> None:
        """Draw the clumps that came to rest since the last call onto the lasting floor."""
        for fall in self._resting:
            radius = self._scraps[fall.piece].radius
            shadow = _shadow(round(radius))
            middle = (round(fall.rest_x), round(fall.rest_y + radius * 0.62))
            corner = (middle[0] - shadow.width // 2, middle[1] - shadow.height // 2)
            floor.paste((24, 25, 26, 255), corner, shadow)
            self._paste(floor, fall.piece, fall.rest_x, fall.rest_y, self._turn(fall, fall.landed))
        self._resting.clear()

    def draw_held(self, canvas: Image.Image, room: Claws, trolley: int, frame: int) -> None:
        """Draw the clumps between the claws, the lowest last."""
        for rank in range(len(self._order) - 1, self._gone - 1, -1):
            x, y = self._held_place(rank, room)
            piece = int(self._order[rank])
            self._paste(canvas, piece, trolley + x, HINGE_Y + y, float(self._angle[piece]))

    def draw_falling(self, canvas: Image.Image, frame: int) -> None:
        """Draw the clumps in the air and those that roll to rest."""
        now = frame / FRAME_RATE_HZ
        for fall in self._falls:
            x, y = fall.place(now) if now < fall.landed else fall.rolling(now)
            self._paste(canvas, fall.piece, x, y, self._turn(fall, min(now, fall.landed)))

    def _turn(self, fall: Fall, until: float) -> float:
        return float(self._angle[fall.piece]) + fall.spin * (until - fall.released)

    def _paste(self, canvas: Image.Image, piece: int, x: float, y: float, angle: float) -> None:
        picture = self._scraps[piece].picture(angle)
        corner = (round(x) - picture.width // 2, round(y) - picture.height // 2)
        canvas.paste(picture, corner, picture)


def _shadow(radius: int) -> Image.Image:
    """A soft patch of shade below a clump, L."""
    width, height = radius * 4, radius * 2
    image = Image.new("L", (width, height))
    box = (width * 0.2, height * 0.28, width * 0.8, height * 0.72)
    ImageDraw.Draw(image).ellipse(box, fill=90)
    return image.filter(ImageFilter.GaussianBlur(radius * 0.25))
