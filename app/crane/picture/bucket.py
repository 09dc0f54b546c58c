"""The bucket: trolley, cables, and two claws that stand exactly as far open as the run says.

Env1's claws are forks of curved tines, Env2's are closed shells. Both turn about two hinges in the
head. Here too is the room between the claws, which says where the held waste can be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from PIL import Image, ImageChops, ImageDraw, ImageFilter

from app.crane.environments import FloatArray

from .stage import SUPERSAMPLE, Color

# Bucket coordinates: px, origin midway between the hinges, y downward.
LEFT, RIGHT, TOP, FOOT = -84, 84, -34, 88  # the box that holds the claws at any opening
HINGE_X = 9.0
FULL_ANGLE = math.radians(36.0)  # turn of each claw between closed and fully open
# One claw, closed, relative to its hinge: shoulder, back, tip. The tips meet below the head.
CLAW_COURSE = ((0.0, 0.0), (22.0, -1.0), (40.0, 7.0), (47.0, 26.0), (41.0, 48.0), (22.0, 66.0))
TIP = (-9.0, 76.0)
ANCHOR = (30.0, 2.0)  # where the cylinder pushes the claw
CYLINDER_FOOT = (7.0, -27.0)  # where the cylinder is held, relative to the bucket
# Held waste heaps above the shoulders at about this slope.
HEAP_SLOPE = 0.55
# Openings are drawn to 1/100: the tips move 0.5 px per step, less than the eye or the codec keeps.
OPENING_STEPS = 100

SHADOW_DEPTH = 0.34  # share of the light that the crane takes from the wall
SHADOW_OFFSET = (-9, 11)  # px; the lamps hang before the crane, above and to the right
SHADOW: Color = (30, 34, 37)

STEEL: Color = (66, 73, 80)
STEEL_DARK: Color = (44, 49, 54)
STEEL_LIGHT: Color = (128, 137, 144)
STEEL_WORN: Color = (176, 182, 186)
INSIDE: Color = (52, 56, 60)
CRANE_YELLOW: Color = (204, 160, 68)
CRANE_YELLOW_DARK: Color = (150, 114, 42)
CRANE_YELLOW_LIGHT: Color = (228, 192, 110)


@dataclass(frozen=True)
class Claws:
    """The picture of both claws at one opening, and the room between them."""

    behind: Image.Image  # drawn before the waste
    before: Image.Image  # drawn after the waste
    shade: Image.Image  # how dark its shadow on the wall is, L
    tip_x: float  # half the gap at the mouth
    tip_y: float
    levels: FloatArray  # (k,) y from the mouth upward
    half_width: FloatArray  # (k,) half the room's width at each level
    area_below: FloatArray  # (k,) px^2 between the mouth and each level

    def level(self, area: FloatArray | float) -> FloatArray:
        """The height that waste of an area reaches: y, px."""
        return np.asarray(np.interp(area, self.area_below, self.levels))

    def half_width_at(self, y: FloatArray | float) -> FloatArray:
        """Half the room's width at a height, px."""
        return np.asarray(np.interp(-np.asarray(y), -self.levels, self.half_width))


def opening_step(opening: float) -> int:
    """The drawn step of an opening from 0 to 1."""
    return round(opening * OPENING_STEPS)


@lru_cache(maxsize=2 * (OPENING_STEPS + 1))  # both environments whole: 37 MB at most
def claws(environment: str, step: int) -> Claws:
    """The claws of an environment at a drawn step of the opening."""
    angle = FULL_ANGLE * step / OPENING_STEPS
    behind, before = _blank(), _blank()
    back, front = ImageDraw.Draw(behind), ImageDraw.Draw(before)
    if environment == "env1":
        _draw_forks(back, front, angle)
    else:
        _draw_shells(back, front, angle)
    _draw_cylinders(front, angle)
    levels, half_width = _room(angle)
    area = np.zeros(len(levels))
    np.cumsum(-np.diff(levels) * (half_width[1:] + half_width[:-1]), out=area[1:])
    tip_x, tip_y = _turned([TIP], angle)[0]
    behind, before = _smooth(behind), _smooth(before)
    return Claws(
        behind=behind,
        before=before,
        shade=shade(ImageChops.lighter(behind.getchannel("A"), before.getchannel("A"))),
        tip_x=max(float(tip_x), 0.0),
        tip_y=float(tip_y),
        levels=levels,
        half_width=half_width,
        area_below=area,
    )


def shade(cover: Image.Image) -> Image.Image:
    """The soft shadow that a part casts on the wall behind it, L."""
    return cover.point([round(value * SHADOW_DEPTH) for value in range(256)]).filter(
        ImageFilter.BoxBlur(4)
    )


def _blank() -> Image.Image:
    size = ((RIGHT - LEFT) * SUPERSAMPLE, (FOOT - TOP) * SUPERSAMPLE)
    return Image.new("RGBA", size, (*STEEL_DARK, 0))


def _smooth(image: Image.Image) -> Image.Image:
    """Average a drawing down. Pillow's own way weights by cover, at four times the cost; here what
    is not covered has the steel's dark colour, so that the plain mean only darkens the edge."""
    fine = np.asarray(image).astype(np.uint16)
    rows = fine[0::2] + fine[1::2]
    return Image.fromarray(((rows[:, 0::2] + rows[:, 1::2]) // SUPERSAMPLE**2).astype(np.uint8))


def _turned(points: Sequence[tuple[float, float]] | FloatArray, angle: float) -> FloatArray:
    """Points of the right claw, relative to its hinge, in bucket coordinates. (k, 2)."""
    x, y = np.asarray(points, dtype=np.float64).T
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.stack([x * cosine + y * sine + HINGE_X, y * cosine - x * sine], axis=1)


@cache
def _course() -> FloatArray:
    """The claw's curved line from hinge to tip, smooth through its control points. (k, 2)."""
    points = np.array([*CLAW_COURSE, TIP])
    padded = np.vstack([2 * points[0] - points[1], points, 2 * points[-1] - points[-2]])
    t = np.linspace(0, 1, 6, endpoint=False)[:, None]
    parts = []
    for p0, p1, p2, p3 in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        bend = 2 * p0 - 5 * p1 + 4 * p2 - p3
        twist = 3 * p1 - p0 - 3 * p2 + p3
        parts.append(0.5 * (2 * p1 + (p2 - p0) * t + bend * t**2 + twist * t**3))
    return np.vstack([*parts, points[-1:]])


def _strip(line: FloatArray, outside: FloatArray, inside: FloatArray) -> FloatArray:
    """The outline of a band along a line: so far to its outer and to its inner side. (2k, 2)."""
    along = np.gradient(line, axis=0)
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return np.vstack([line + outward * outside[:, None], (line - outward * inside[:, None])[::-1]])


def _both_sides(
    draw: ImageDraw.ImageDraw, outline: FloatArray, angle: float, fill: Color, depth: float = 1.0
) -> None:
    """Draw a part of the right claw and its mirror image; depth < 1 lies nearer the middle."""
    turned = _turned(outline, angle)
    for side in (1.0, -1.0):
        draw.polygon(_placed(turned * (side * depth, 1.0)), fill=fill)


def _placed(points: FloatArray) -> list[tuple[float, float]]:
    return [((x - LEFT) * SUPERSAMPLE, (y - TOP) * SUPERSAMPLE) for x, y in points.tolist()]


def _draw_forks(back: ImageDraw.ImageDraw, front: ImageDraw.ImageDraw, angle: float) -> None:
    line = _course()
    count = len(line)
    share = np.linspace(0, 1, count)
    thick = 4.6 * (1 - share) ** 0.6 + 1.0
    for draw, depth, body, light in (
        (back, 0.78, (40, 44, 48), (62, 67, 72)),
        (back, 0.42, (36, 40, 44), (56, 61, 66)),
        (front, 0.60, (58, 64, 70), (98, 106, 112)),
        (front, 1.0, STEEL, STEEL_LIGHT),
    ):
        outline = _strip(line, thick, thick)
        _both_sides(draw, outline, angle, body, depth)
        edge = _strip(line, thick, 0.9 - thick)
        _both_sides(draw, edge[2 : 2 * count - 2], angle, light, depth)
        worn = slice(count - 4, count)
        _both_sides(draw, _strip(line[worn], thick[worn], thick[worn]), angle, STEEL_WORN, depth)
    # The crossbeam that carries the tines.
    beam = _strip(line[4:12], np.full(8, 6.5), np.full(8, 6.0))
    _both_sides(front, beam, angle, STEEL)
    _both_sides(front, _strip(line[4:12], np.full(8, 6.5), np.full(8, -4.6)), angle, STEEL_LIGHT)


def _draw_shells(back: ImageDraw.ImageDraw, front: ImageDraw.ImageDraw, angle: float) -> None:
    line = _course()
    count = len(line)
    # The far side plate closes each shell behind the waste.
    inner_edge = np.array([TIP, (-9.0, 8.0), (0.0, 0.0)])
    _both_sides(back, np.vstack([line, inner_edge]), angle, INSIDE)
    # The near side plate is cut out, so that the load is seen; its rim and rib are steel.
    full = np.full(count, 3.5)
    outline = _strip(line, full, np.interp(np.linspace(0, 1, count), [0, 0.3, 1], [5.0, 7.5, 5.0]))
    _both_sides(front, outline, angle, STEEL)
    _both_sides(front, _strip(line, full, full * 0 - 1.9), angle, STEEL_LIGHT)
    lip = np.array([(-9.0, 76.0), (-9.0, 66.0), (6.0, 58.0), (27.0, 58.0), (24.0, 67.0)])
    _both_sides(front, lip, angle, STEEL)
    edge = np.array([(-9.0, 76.0), (-9.0, 70.0), (8.0, 64.5), (12.0, 72.0), (-4.0, 78.0)])
    _both_sides(front, edge, angle, STEEL_WORN)
    arm = np.array([(-3.0, -4.0), (30.0, -6.0), (42.0, 6.0), (34.0, 12.0), (3.0, 6.0)])
    _both_sides(front, arm, angle, STEEL)
    rivets = _turned([line[k] - (3.0, 0.0) for k in (14, 19, 24, 29)], angle)
    for x, y in rivets.tolist():
        for side in (1.0, -1.0):
            (px, py) = _placed(np.array([(x * side, y)]))[0]
            front.ellipse((px - 2, py - 2, px + 2, py + 2), fill=STEEL_DARK)


def _draw_cylinders(draw: ImageDraw.ImageDraw, angle: float) -> None:
    """Each claw's hydraulic cylinder, from the head to the shoulder."""
    end = _turned([ANCHOR], angle)[0]
    start = np.array(CYLINDER_FOOT)
    middle = start + (end - start) * 0.62
    for side in (1.0, -1.0):
        mirror = np.array((side, 1.0))
        rod = _placed(np.array([middle, end]) * mirror)
        barrel = _placed(np.array([start, middle]) * mirror)
        draw.line(rod, fill=STEEL_WORN, width=5)
        draw.line(barrel, fill=STEEL_DARK, width=11)
        draw.line(barrel, fill=(86, 94, 101), width=4)
        for (x, y), radius in ((rod[1], 6), (_placed(_turned([(0, 0)], angle) * mirror)[0], 9)):
            draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=STEEL_DARK)
            draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=STEEL_LIGHT)


def _room(angle: float) -> tuple[FloatArray, FloatArray]:
    """Heights from the mouth upward, and half the width between the claws there."""
    line = _turned(_course(), angle) - np.array((3.0, 0.0))
    widest = int(np.argmax(line[:, 0]))
    rim = max(widest - 4, 0)
    wall = line[rim:][::-1]  # from the tip up to the shoulder
    heights = np.minimum.accumulate(wall[:, 1])
    bottom, top = float(heights[0]), float(heights[-1])
    shoulder = float(wall[-1, 0])
    peak = top - shoulder * HEAP_SLOPE
    levels = np.arange(bottom, peak, -1.0)
    # Above the shoulders the waste stands as a heap; np.interp wants rising abscissae.
    half = np.interp(-levels, np.append(-heights, -peak), np.append(wall[:, 0], 2.0))
    return levels, np.maximum(half, 0.5)


HOIST_LEFT, HOIST_RIGHT, HOIST_TOP, HOIST_FOOT = -46, 46, 26, 142  # frame y, x from the trolley
TROLLEY_FOOT = 62


@cache
def hoist() -> Image.Image:
    """Trolley, cables and head: all that hangs still under the rail."""
    scale = SUPERSAMPLE
    size = ((HOIST_RIGHT - HOIST_LEFT) * scale, (HOIST_FOOT - HOIST_TOP) * scale)
    image = Image.new("RGBA", size, (*STEEL_DARK, 0))
    draw = ImageDraw.Draw(image)

    def box(left: float, top: float, right: float, foot: float, fill: Color) -> None:
        draw.rectangle(
            (
                (left - HOIST_LEFT) * scale,
                (top - HOIST_TOP) * scale,
                (right - HOIST_LEFT) * scale - 1,
                (foot - HOIST_TOP) * scale - 1,
            ),
            fill=fill,
        )

    def disc(x: float, y: float, radius: float, fill: Color) -> None:
        center_x, center_y = (x - HOIST_LEFT) * scale, (y - HOIST_TOP) * scale
        reach = radius * scale
        draw.ellipse(
            (center_x - reach, center_y - reach, center_x + reach, center_y + reach), fill=fill
        )

    for x in (-15.0, -11.0, 11.0, 15.0):
        box(x - 0.5, 60, x + 1.0, 104, (38, 42, 46))
    box(-40, 42, 40, 62, CRANE_YELLOW)
    box(-40, 42, 40, 44.5, CRANE_YELLOW_LIGHT)
    box(-40, 58, 40, 62, CRANE_YELLOW_DARK)
    for x in (-28.0, 28.0):
        box(x - 5, 35, x + 5, 46, STEEL_DARK)
        disc(x, 37, 5.5, STEEL_DARK)
        disc(x, 37, 3.0, STEEL_LIGHT)
    disc(-13, 54, 9.5, STEEL_DARK)
    disc(13, 54, 9.5, STEEL_DARK)
    disc(-13, 54, 5.5, STEEL)
    disc(13, 54, 5.5, STEEL)
    box(-20, 100, 20, 122, CRANE_YELLOW)
    box(-20, 100, 20, 102.5, CRANE_YELLOW_LIGHT)
    box(-20, 118, 20, 122, CRANE_YELLOW_DARK)
    disc(-13, 104, 5, STEEL_DARK)
    disc(13, 104, 5, STEEL_DARK)
    box(-12, 120, 12, 142, STEEL)
    box(-12, 120, -10, 142, STEEL_LIGHT)
    box(8, 120, 12, 142, STEEL_DARK)
    return image.reduce(scale)


@cache
def hoist_shade() -> Image.Image:
    """The hoist's shadow on the wall. L. The trolley runs on the girder, and casts none."""
    cover = hoist().getchannel("A")
    cover.paste(0, (0, 0, cover.width, TROLLEY_FOOT - HOIST_TOP))
    return shade(cover)
