"""What a clump of shredded paper and packing looks like: crumpled sheets, card, film and shreds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from PIL import Image, ImageDraw

from app.crane.environments import FloatArray

from .stage import SUPERSAMPLE, Color

# Each family: the colours of its larger scraps, light to dark. Paper is the commonest.
FAMILIES: tuple[tuple[Color, Color, Color], ...] = (
    ((248, 246, 238), (226, 223, 213), (190, 187, 178)),  # office paper
    ((240, 236, 222), (214, 209, 194), (176, 171, 157)),  # newsprint
    ((208, 168, 120), (182, 141, 95), (143, 108, 70)),  # card
    ((222, 190, 148), (196, 160, 116), (152, 121, 84)),  # light card
    ((150, 186, 206), (116, 156, 182), (82, 118, 144)),  # blue film
    ((222, 132, 108), (192, 100, 80), (146, 72, 58)),  # red packing
    ((166, 190, 142), (134, 162, 110), (98, 124, 80)),  # green packing
)
FAMILY_CHANCE = (0.34, 0.18, 0.14, 0.10, 0.09, 0.08, 0.07)
SHRED_COLORS: tuple[Color, ...] = (
    (250, 248, 242),
    (236, 232, 222),
    (228, 222, 206),
    (214, 186, 148),
    (166, 194, 208),
)
SHRED_EDGE: Color = (150, 146, 136)
TURNS = 24  # pictures of a falling clump per full turn


@dataclass
class Scrap:
    """One clump: its size, and its picture at any turn."""

    radius: float  # px, of the disc of the clump's area
    fine: Image.Image  # supersampled, square
    _turned: dict[int, Image.Image] = field(default_factory=dict)

    def picture(self, angle: float) -> Image.Image:
        """The clump turned by an angle (radians), RGBA, its middle in the middle."""
        turn = round(angle / (2 * math.pi) * TURNS) % TURNS
        if turn not in self._turned:
            turned = self.fine.rotate(turn * 360 / TURNS, Image.Resampling.BILINEAR)
            self._turned[turn] = turned.reduce(SUPERSAMPLE)
        return self._turned[turn]


def scrap(radius: float, rng: np.random.Generator) -> Scrap:
    """Draw one clump of a size."""
    half = math.ceil(radius * 1.55) + 2
    side = 2 * half * SUPERSAMPLE
    image = Image.new("RGBA", (side, side), (150, 148, 142, 0))
    draw = ImageDraw.Draw(image)
    middle = np.array((side / 2, side / 2))
    size = radius * SUPERSAMPLE
    family = FAMILIES[rng.choice(len(FAMILIES), p=FAMILY_CHANCE)]
    other = FAMILIES[rng.choice(len(FAMILIES), p=FAMILY_CHANCE)]
    _shreds(draw, middle, size, rng, int(rng.integers(4, 7)))
    for colors, share in ((other, 0.7), (family, 0.8), (family, 0.62)):
        offset = rng.normal(0, 0.3, 2) * size
        _crumple(draw, middle + offset, size * share, colors, rng)
    _shreds(draw, middle, size * 0.8, rng, int(rng.integers(2, 4)))
    return Scrap(radius=radius, fine=image)


def _crumple(
    draw: ImageDraw.ImageDraw,
    middle: FloatArray,
    size: float,
    colors: tuple[Color, Color, Color],
    rng: np.random.Generator,
) -> None:
    """An irregular polygon folded along lines that meet near its middle, lit from above."""
    corners = int(rng.integers(5, 9))
    angle = np.sort((np.arange(corners) + rng.uniform(-0.35, 0.35, corners)) / corners) * 2 * np.pi
    reach = size * rng.uniform(0.72, 1.22, corners)
    flat = np.array((1.0, rng.uniform(0.7, 1.0)))
    outline = middle + np.stack([np.cos(angle), np.sin(angle)], axis=1) * reach[:, None] * flat
    fold = middle + rng.normal(0, 0.2, 2) * size
    for k in range(corners):
        first, second = outline[k], outline[(k + 1) % corners]
        facing = (first + second) / 2 - fold
        up = -facing[1] - 0.4 * facing[0]
        shade = colors[0] if up > 0.25 * size else colors[1] if up > -0.45 * size else colors[2]
        draw.polygon([tuple(fold), tuple(first), tuple(second)], fill=shade)


def _shreds(
    draw: ImageDraw.ImageDraw,
    middle: FloatArray,
    size: float,
    rng: np.random.Generator,
    count: int,
) -> None:
    """Strips from the shredder that lie across the clump, their ends sticking out a little."""
    t = np.linspace(-1, 1, 7)
    for _ in range(count):
        center = middle + rng.uniform(-0.55, 0.55, 2) * size
        way = rng.uniform(0, np.pi)
        along = np.array((math.cos(way), math.sin(way)))
        across = np.array((-along[1], along[0]))
        half = size * rng.uniform(0.45, 0.95)
        bend = half * rng.normal(0, 0.3)
        line = center + along * (half * t)[:, None] + across * (bend * t * t)[:, None]
        color = SHRED_COLORS[int(rng.integers(len(SHRED_COLORS)))]
        points = [tuple(point) for point in line.tolist()]
        # A darker edge below keeps white strips apart where they cross.
        draw.line([(x, y + 2) for x, y in points], fill=SHRED_EDGE, width=3, joint="curve")
        draw.line(points, fill=color, width=3, joint="curve")
