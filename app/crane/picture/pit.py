"""The pit behind the crane: concrete wall and floor, girder and rail. It never changes."""

from __future__ import annotations

from functools import cache

import numpy as np
from PIL import Image, ImageDraw

from app.crane.environments import FloatArray

from .stage import HEIGHT, SUPERSAMPLE, WALL_FOOT_Y, WIDTH, Color

# The grain of the concrete: the same in every video.
CONCRETE_SEED = 7
WALL_LEFT, WALL_RIGHT = 22, WIDTH - 22
# A grey whose colour survives 8-bit chroma: one step off and the wall turns purple.
WALL_LIGHT: Color = (145, 151, 154)
SIDE_WALL: Color = (112, 115, 116)
FLOOR_NEAR: Color = (96, 98, 98)
FLOOR_FAR: Color = (120, 121, 119)
PANEL_WIDTH, PANEL_TOP, PANEL_HEIGHT = 149, 24, 97
GIRDER_TOP, GIRDER_FOOT = 10, 34
GIRDER: Color = (62, 69, 76)
CEILING: Color = (40, 44, 48)


@cache
def pit() -> Image.Image:
    """The empty pit, RGBA. Callers draw on a copy."""
    size = (WIDTH * SUPERSAMPLE, HEIGHT * SUPERSAMPLE)
    image = Image.new("RGB", size, WALL_LIGHT)
    draw = ImageDraw.Draw(image)
    _walls_and_floor(draw)
    _panels(draw)
    lit = _weathered(image.reduce(SUPERSAMPLE)).resize(size, Image.Resampling.NEAREST)
    _girder(ImageDraw.Draw(lit))
    return lit.reduce(SUPERSAMPLE).convert("RGBA")


def _scaled(*points: tuple[float, float]) -> list[tuple[float, float]]:
    return [(x * SUPERSAMPLE, y * SUPERSAMPLE) for x, y in points]


def _walls_and_floor(draw: ImageDraw.ImageDraw) -> None:
    foot = WALL_FOOT_Y
    for y in range(foot, HEIGHT):
        near = (y - foot) / (HEIGHT - foot)
        color = tuple(
            round(far + (close - far) * near)
            for far, close in zip(FLOOR_FAR, FLOOR_NEAR, strict=True)
        )
        draw.rectangle(_scaled((0, y), (WIDTH, y + 1)), fill=color)
    left = _scaled((0, 0), (WALL_LEFT, 0), (WALL_LEFT, foot), (0, foot + 26))
    right = [(WIDTH * SUPERSAMPLE - x, y) for x, y in left]
    for side in (left, right):
        draw.polygon(side, fill=SIDE_WALL)
        draw.line(side[1:3], fill=(98, 101, 102), width=2)
        draw.line(side[2:4], fill=(74, 76, 77), width=3)
    draw.line(_scaled((WALL_LEFT, foot), (WALL_RIGHT, foot)), fill=(82, 84, 84), width=3)


def _panels(draw: ImageDraw.ImageDraw) -> None:
    """Joints of the cast panels and the holes of their ties."""
    dark, light = (124, 129, 131), (157, 161, 163)
    for row in range(1, 4):
        y = PANEL_TOP + row * PANEL_HEIGHT
        if y < WALL_FOOT_Y:
            draw.line(_scaled((WALL_LEFT, y), (WALL_RIGHT, y)), fill=dark, width=2)
            draw.line(_scaled((WALL_LEFT, y + 1), (WALL_RIGHT, y + 1)), fill=light, width=2)
    for column in range(5):
        x = WALL_LEFT + column * PANEL_WIDTH
        if column:
            draw.line(_scaled((x, 0), (x, WALL_FOOT_Y)), fill=dark, width=2)
            draw.line(_scaled((x + 1, 0), (x + 1, WALL_FOOT_Y)), fill=light, width=2)
        for row in range(3):
            for across in (0.2, 0.8):
                for down in (0.24, 0.76):
                    hole_x = x + across * PANEL_WIDTH
                    hole_y = PANEL_TOP + (row + down) * PANEL_HEIGHT
                    if hole_x < WALL_RIGHT and hole_y < WALL_FOOT_Y - 6:
                        box = _scaled((hole_x - 1.6, hole_y - 1.6), (hole_x + 1.6, hole_y + 1.6))
                        draw.ellipse(box, fill=(128, 131, 131))


def _weathered(image: Image.Image) -> Image.Image:
    """Light from above, dark corners, and the mottling and run marks of old concrete."""
    width, height = image.size
    rng = np.random.default_rng(CONCRETE_SEED)
    x = (np.arange(width) + 0.5)[None, :] / width
    y = (np.arange(height) + 0.5)[:, None] / height
    light = 1.07 - 0.52 * (x - 0.5) ** 2 - 0.30 * np.maximum(y - 0.45, 0) ** 2
    light -= 0.26 * np.exp(-y / 0.09)
    # The corner between wall and floor gathers shadow.
    light -= 0.10 * np.exp(-np.abs(y - WALL_FOOT_Y / HEIGHT) / 0.03)
    light += 0.022 * _noise(rng, (6, 10), (width, height))
    light += 0.014 * _noise(rng, (24, 40), (width, height))
    light += 0.018 * _noise(rng, (2, 90), (width, height)) * (y < WALL_FOOT_Y / HEIGHT)
    light += 0.008 * rng.standard_normal((height, width))
    shaded = np.asarray(image, dtype=np.float64) * light[:, :, None]
    return Image.fromarray(np.clip(np.rint(shaded), 0, 255).astype(np.uint8))


def _noise(rng: np.random.Generator, cells: tuple[int, int], size: tuple[int, int]) -> FloatArray:
    """Smooth noise: a coarse grid (rows, columns) of unit normals, enlarged. (height, width)."""
    coarse = rng.standard_normal(cells).astype(np.float32)
    enlarged = Image.fromarray(coarse).resize(size, Image.Resampling.BICUBIC)
    return np.asarray(enlarged, dtype=np.float64)


def _girder(draw: ImageDraw.ImageDraw) -> None:
    """The I-beam the trolley runs on, seen from the side."""
    draw.rectangle(_scaled((0, 0), (WIDTH, GIRDER_TOP)), fill=CEILING)
    draw.rectangle(_scaled((0, GIRDER_TOP), (WIDTH, GIRDER_FOOT)), fill=GIRDER)
    for x in range(20, WIDTH, 60):
        draw.rectangle(_scaled((x, GIRDER_TOP + 4), (x + 2, GIRDER_FOOT - 5)), fill=(51, 57, 63))
        draw.rectangle(
            _scaled((x + 2, GIRDER_TOP + 4), (x + 3, GIRDER_FOOT - 5)), fill=(80, 87, 94)
        )
    draw.rectangle(_scaled((0, GIRDER_TOP), (WIDTH, GIRDER_TOP + 3)), fill=(86, 94, 101))
    draw.rectangle(_scaled((0, GIRDER_TOP + 3), (WIDTH, GIRDER_TOP + 4)), fill=(44, 49, 54))
    draw.rectangle(_scaled((0, GIRDER_FOOT - 5), (WIDTH, GIRDER_FOOT)), fill=(92, 100, 107))
    draw.rectangle(_scaled((0, GIRDER_FOOT - 5), (WIDTH, GIRDER_FOOT - 4)), fill=(128, 136, 142))
    draw.rectangle(_scaled((0, GIRDER_FOOT), (WIDTH, GIRDER_FOOT + 1.5)), fill=(36, 40, 44))
