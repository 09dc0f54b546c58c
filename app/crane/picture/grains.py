"""Chopped straw: what the bucket still holds, the stream that falls, the pile that grows (Env2).

The mass that leaves between two samples falls as straws of equal mass, each with the trolley's own
speed. Where a straw lands the pile's height profile grows, and slides where it is too steep.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from app.crane.dynamics import SAMPLE_RATE_HZ, SAMPLES, Run
from app.crane.environments import FloatArray, environment_named

from .bucket import FOOT, LEFT, RIGHT, TOP, Claws, claws, opening_step
from .stage import (
    FRAME_RATE_HZ,
    GRAVITY,
    HEIGHT,
    HINGE_Y,
    LANDING_Y,
    SUPERSAMPLE,
    TROLLEY_SPEED,
    WIDTH,
    Color,
    trolley_x_at,
)

HELD_AREA = 5300.0  # px^2 of the bucket that a grasp of the mean weight fills
PILE_AREA = 8600.0  # px^2 of pile that the same grasp makes on the floor: it lies looser there
STRAWS = 1700  # straws in a grasp of the mean weight
STRAW_LENGTH = 6.0  # px
STEEPEST = 0.88  # slope at which a pile of straw slides: about 41 degrees
SLOPE_PATCH = 16  # px over which that slope changes
ROUNDING = 11  # px
SLIDE_STRIDES = (8, 4, 2, 1)  # columns; wide strides first, so that a high pile settles fast
SLIDE_ROUNDS = 10  # per frame, while anything is too steep
DEEPEST = 10.0  # px the foot of a high pile reaches toward the camera
PILE_TOP = LANDING_Y - 122  # no pile stands higher than the bucket's mouth
TEXTURE_SEED = 11
SHADES: tuple[Color, ...] = (
    (238, 208, 132),
    (224, 188, 104),
    (208, 168, 84),
    (186, 146, 66),
    (160, 122, 52),
)


class Grains:
    """The straw of one run, frame by frame."""

    def __init__(self, run: Run, rng: np.random.Generator) -> None:
        mean_weight = environment_named(run.environment).grasp.weight
        self._share_held = run.weight / mean_weight  # (501,)
        self._full = float(self._share_held[0])
        released = np.maximum.accumulate(run.weight[0] - run.weight) / mean_weight * STRAWS
        count = int(released[-1])
        # A rising ramp far below one straw makes the inverse unique where nothing falls.
        rising = released + np.arange(SAMPLES) * 1e-9
        self._time = np.interp(
            np.arange(count) + 0.5, rising, np.arange(SAMPLES) / SAMPLE_RATE_HZ
        )  # (n,) s
        opening = np.interp(self._time, np.arange(SAMPLES) / SAMPLE_RATE_HZ, run.opening)
        mouth_x, mouth_y = _mouth(run.environment, opening)
        across = rng.uniform(-1, 1, count)
        self._x = trolley_x_at(self._time) + across * np.maximum(mouth_x * 0.72, 2.0)
        self._y = HINGE_Y + mouth_y - rng.uniform(2, 9, count)
        # The stream fans out a little.
        self._speed_x = TROLLEY_SPEED + across * 9 + rng.normal(0, 5, count)
        self._speed_y = rng.uniform(35, 75, count)
        self._lean = rng.normal(0, 0.5, count)
        self._shade = _packed(SHADES)[rng.integers(0, len(SHADES), count)]
        self._next = 0  # straws up to here have left the bucket
        self._falling = np.zeros(0, dtype=np.int64)
        self._height = np.zeros(WIDTH)
        self._drawn = np.zeros(WIDTH)
        self._ragged = rng.uniform(0, 1, WIDTH)
        # Straw does not slide at one angle everywhere: without this a heap is a drawn triangle.
        knots = rng.uniform(0.72, 1.2, WIDTH // SLOPE_PATCH + 2)
        self._steepest = STEEPEST * np.interp(
            np.arange(WIDTH) / SLOPE_PATCH, np.arange(len(knots)), knots
        )
        self._floor: NDArray[np.float32] | None = None  # the bare floor behind the pile

    def advance(self, frame: int) -> None:
        """Let straw leave, fall and land up to a frame's time."""
        now = frame / FRAME_RATE_HZ
        until = int(np.searchsorted(self._time, now, side="right"))
        self._falling = np.concatenate([self._falling, np.arange(self._next, until)])
        self._next = until
        if len(self._falling):
            x, y, _, _ = self._where(now)
            column = np.clip(np.rint(x).astype(np.int64), 3, WIDTH - 4)
            landed = y >= LANDING_Y - self._height[column]
            if landed.any():
                self._pile_up(column[landed])
                self._falling = self._falling[~landed]
        self._slide()

    def _where(self, now: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Place and speed of the falling straws: x, y, px, and their speeds, px/s."""
        which = self._falling
        since = now - self._time[which]
        x = self._x[which] + self._speed_x[which] * since
        y = self._y[which] + (self._speed_y[which] + 0.5 * GRAVITY * since) * since
        return x, y, self._speed_x[which], self._speed_y[which] + GRAVITY * since

    def _pile_up(self, columns: NDArray[np.int64]) -> None:
        landed = np.bincount(columns, minlength=WIDTH) * (PILE_AREA / STRAWS)
        self._height += np.convolve(landed, np.array([1, 2, 3, 3, 3, 2, 1]) / 15, mode="same")

    def _slide(self) -> None:
        """Let the pile slide where it is too steep: straw goes down the slope, none is lost."""
        height = self._height
        if np.all(np.abs(np.diff(height)) < self._steepest[1:] * 1.1):
            return
        for _ in range(SLIDE_ROUNDS):
            for stride in SLIDE_STRIDES:
                step = height[stride:] - height[:-stride]
                limit = self._steepest[stride:] * stride
                slide = (step - np.clip(step, -limit, limit)) * 0.25
                height[:-stride] += slide
                height[stride:] -= slide

    def draw_pile(self, floor: Image.Image) -> None:
        """Draw what has landed since the last call onto the lasting picture of the floor."""
        if self._floor is None:
            self._floor = np.asarray(floor.convert("RGB"), dtype=np.float32)[PILE_TOP:]
        # A little rounding takes the drawn edge off a heap's top and foot.
        rounded = np.convolve(self._height, np.full(ROUNDING, 1 / ROUNDING), mode="same")
        changed = np.flatnonzero(np.abs(rounded - self._drawn) > 0.04)
        if not len(changed):
            return
        left, right = int(changed[0]), int(changed[-1]) + 1
        height = rounded[left:right].astype(np.float32)
        # What slid away is drawn over too.
        highest = max(float(height.max()), float(self._drawn[left:right].max()))
        self._drawn[left:right] = height
        thin = np.minimum(height, 3.0)
        ragged = self._ragged[left:right].astype(np.float32)
        surface = LANDING_Y - height - (ragged - 0.5) * thin
        foot = LANDING_Y + np.minimum(height * 0.22, DEEPEST) + ragged * thin
        top = max(int(LANDING_Y - highest) - 4, PILE_TOP)
        y = np.arange(top, HEIGHT, dtype=np.float32)[:, None] + 0.5  # (rows, 1)
        depth = y - surface
        cover = np.clip(depth + 0.5, 0, 1) * np.clip(foot - y + 0.5, 0, 1)
        # Light falls on the surface; the pile darkens inward and toward its foot.
        light = 1.12 - 0.16 * np.clip(depth / 8, 0, 1) - 0.14 * np.clip(depth / 50, 0, 1)
        light -= 0.22 * np.clip((y - foot + 7) / 7, 0, 1)
        shadow = 1 - 0.35 * np.clip(1 - np.abs(y - foot) / 4, 0, 1) * np.clip(height / 3, 0, 1)
        straw = _pile_texture()[top - PILE_TOP :, left:right] * light[:, :, None]
        bare = self._floor[top - PILE_TOP :, left:right] * shadow[:, :, None]
        blend = bare + (straw - bare) * cover[:, :, None]
        patch = np.clip(blend, 0, 255).astype(np.uint8)
        floor.paste(Image.fromarray(patch), (left, top))

    def draw_held(self, canvas: Image.Image, room: Claws, trolley: int, frame: int) -> None:
        """Draw the straw between the claws."""
        share = float(self._share_held[frame * SAMPLE_RATE_HZ // FRAME_RATE_HZ])
        if share * HELD_AREA < 8:
            return
        level = float(room.level(share * HELD_AREA))
        # A full load is heaped; it hollows while it runs out.
        heap = 7.0 if share > 0.9 * self._full else 7.0 - 12.0 * min(0.9 - share / self._full, 0.5)
        sides = room.levels[room.levels >= level]
        half = room.half_width[: len(sides)]
        across = np.linspace(1, -1, 15) * half[-1]
        top = level + heap * (np.linspace(1, -1, 15) ** 2 * 1.5 - 0.5)
        outline = np.concatenate(
            [
                np.stack([half, sides], axis=1),
                np.stack([across, top], axis=1),
                np.stack([-half[::-1], sides[::-1]], axis=1),
            ]
        )
        mask = Image.new("L", ((RIGHT - LEFT) * SUPERSAMPLE, (FOOT - TOP) * SUPERSAMPLE))
        points = ((outline - (LEFT, TOP)) * SUPERSAMPLE).ravel().tolist()
        ImageDraw.Draw(mask).polygon(points, fill=255)
        # The straw sinks with its surface.
        sunk = int(level - room.levels[-1])
        picture = _held_texture().crop((0, 200 - sunk, RIGHT - LEFT, 200 - sunk + FOOT - TOP))
        canvas.paste(picture, (trolley + LEFT, HINGE_Y + TOP), mask.reduce(SUPERSAMPLE))

    def draw_falling(self, canvas: Image.Image, frame: int) -> None:
        """Draw the stream."""
        if not len(self._falling):
            return
        x, y, speed_x, speed_y = self._where(frame / FRAME_RATE_HZ)
        # Straws fall more or less along their way; the lean keeps them from looking like rain.
        angle = np.arctan2(speed_x, speed_y) + self._lean[self._falling]
        steps = np.linspace(-0.5, 0.5, int(STRAW_LENGTH * SUPERSAMPLE)) * STRAW_LENGTH
        at_x = (x[:, None] + np.sin(angle)[:, None] * steps) * SUPERSAMPLE
        at_y = (y[:, None] + np.cos(angle)[:, None] * steps) * SUPERSAMPLE
        left = max(int(at_x.min()) // SUPERSAMPLE - 1, 0)
        right = min(int(at_x.max()) // SUPERSAMPLE + 2, WIDTH)
        top = max(int(at_y.min()) // SUPERSAMPLE - 1, 0)
        foot = min(int(at_y.max()) // SUPERSAMPLE + 2, HEIGHT)
        if right - left < 2 or foot - top < 2:
            return
        wide, high = (right - left) * SUPERSAMPLE, (foot - top) * SUPERSAMPLE
        fine = np.zeros((high, wide), dtype=np.uint32)
        column = np.clip(at_x.astype(np.int64) - left * SUPERSAMPLE, 0, wide - 2)
        row = np.clip(at_y.astype(np.int64) - top * SUPERSAMPLE, 0, high - 1)
        shade = self._shade[self._falling][:, None]
        fine[row, column] = shade
        fine[row, column + 1] = shade
        # Empty points are all zero, so that the mean is a colour already weighted by its cover.
        points = fine.view(np.uint8).reshape(high, wide, 4).astype(np.uint16)
        pairs = points[0::2] + points[1::2]
        mean = (pairs[:, 0::2] + pairs[:, 1::2]) // SUPERSAMPLE**2
        below = np.asarray(canvas.crop((left, top, right, foot)))
        keep = 255 - mean[:, :, 3:]
        patch = (mean[:, :, :3] + below[:, :, :3] * keep // 255).astype(np.uint8)
        canvas.paste(Image.fromarray(patch), (left, top))


def _mouth(environment: str, opening: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Half the gap and its height at some openings, from a few drawn ones. px."""
    at = np.linspace(0, 1, 9)
    drawn = [claws(environment, opening_step(float(o))) for o in at]
    return (
        np.interp(opening, at, [c.tip_x for c in drawn]),
        np.interp(opening, at, [c.tip_y for c in drawn]),
    )


def _packed(colors: tuple[Color, ...]) -> NDArray[np.uint32]:
    """Opaque colours as one number each, in the byte order of RGBA."""
    bytes_ = np.array([(*color, 255) for color in colors], dtype=np.uint8)
    return bytes_.view(np.uint32).ravel()


def _straw_bed(width: int, height: int, density: float) -> Image.Image:
    """A bed of straws lying in all directions, RGB."""
    rng = np.random.default_rng(TEXTURE_SEED)
    image = Image.new("RGB", (width * SUPERSAMPLE, height * SUPERSAMPLE), (182, 142, 66))
    draw = ImageDraw.Draw(image)
    count = int(width * height * density)
    x, y = rng.uniform(0, width, count), rng.uniform(0, height, count)
    angle = rng.normal(0, 0.6, count)
    reach_x, reach_y = np.cos(angle) * STRAW_LENGTH / 2, np.sin(angle) * STRAW_LENGTH / 2
    ends = np.stack([x - reach_x, y - reach_y, x + reach_x, y + reach_y], axis=1) * SUPERSAMPLE
    shades = rng.integers(0, len(SHADES), count)
    for line, shade in zip(ends.tolist(), shades.tolist(), strict=True):
        draw.line(line, fill=SHADES[shade], width=2)
    return image.reduce(SUPERSAMPLE)


@cache
def _pile_texture() -> NDArray[np.float32]:
    """Straw for the pile, fixed to the floor. (rows, WIDTH, 3)."""
    return np.asarray(_straw_bed(WIDTH, HEIGHT - PILE_TOP, 0.22), dtype=np.float32)


@cache
def _held_texture() -> Image.Image:
    """Straw for the bucket, tall enough to sink by a whole load."""
    return _straw_bed(RIGHT - LEFT, 200 + FOOT - TOP, 0.22).convert("RGBA")
