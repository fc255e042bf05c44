"""The van that carries the pad: its panels as decals at their heights, its sides, its shadow on the road.

Its frame is the pad's: forward, right, from the landmark's centre, which lies over the middle of the roof. The panels
are flat; the sides are filled between the outlines of road and roof.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.simulator.decals import Decal, decal, grid, inside, paint, rectangle
from drivers.simulator.textures import Plane

HALF_WIDTH_M = 0.98
ROOF_FRONT_M = 1.55
ROOF_BACK_M = -2.15
NOSE_M = 2.75
TEXEL_M = 0.004
SHADOW_TEXEL_M = 0.02
PAINT = 0.34
GLASS = 0.035
RUBBER = 0.03
SIDE = 0.13
"""Reflectance times the light that the sides get from a high sun."""
BONNET_SHARE = 0.55
SCREEN_SHARE = 0.80
"""Heights of bonnet and windscreen over that of the roof."""
SHADE = 0.30
"""Light that the sky alone gives, over that of sun and sky."""


@dataclass(frozen=True, slots=True)
class Panel:
    """A decal and its height.

    Attributes:
        picture: The decal, in the pad frame.
        height_m: Over the ground.
    """

    picture: Decal
    height_m: float


@dataclass(frozen=True, slots=True)
class Van:
    """The whole van, in the order in which it is drawn.

    Attributes:
        shadow: On the road.
        body: Outline (n, 2) forward, right of road and roof; the sides are the hull of both.
        body_height_m: Height of the body's top for the hull.
        panels: From low to high.
    """

    shadow: Panel
    body: NDArray[np.float64]
    body_height_m: float
    panels: tuple[Panel, ...]


def _canvas(front: float, back: float, half: float, texel: float) -> tuple[Plane, Plane, float, float]:
    """(forward, right, front, left) of a grid whose sides are multiples of 32 texels."""
    rows = int(np.ceil((front - back) / texel / 32.0)) * 32
    columns = int(np.ceil(2 * half / texel / 32.0)) * 32
    top, left = (front + back) / 2 + rows * texel / 2, -columns * texel / 2
    forward, right = grid(rows, columns, texel, top, left)
    return forward, right, top, left


def _roof(deck_half_m: float, source: np.random.Generator) -> Decal:
    """Painted roof with ribs and rack rails; the deck is a matt board in its middle."""
    forward, right, top, left = _canvas(ROOF_FRONT_M, ROOF_BACK_M, HALF_WIDTH_M, TEXEL_M)
    outline = rectangle(ROOF_FRONT_M, HALF_WIDTH_M - 0.06, ROOF_BACK_M, -HALF_WIDTH_M + 0.06)
    alpha = inside(forward, right, outline, TEXEL_M)
    value = np.full(forward.shape, PAINT, dtype=np.float32)
    # A long roof reflects a changing piece of the sky.
    value *= (1.0 + 0.10 * np.cos(1.3 * forward + 0.4) - 0.10 * (right / HALF_WIDTH_M) ** 2).astype(np.float32)
    for position in (-0.62, -0.31, 0.0, 0.31, 0.62):
        rib = rectangle(ROOF_FRONT_M - 0.2, position + 0.012, ROOF_BACK_M + 0.15, position - 0.012)
        paint(value, 0.8 * inside(forward, right, rib, 0.012), PAINT * 0.6)
        lit = rectangle(ROOF_FRONT_M - 0.2, position + 0.024, ROOF_BACK_M + 0.15, position + 0.012)
        paint(value, 0.5 * inside(forward, right, lit, 0.008), PAINT * 1.35)
    for side in (-1.0, 1.0):
        inner, outer = sorted((side * (HALF_WIDTH_M - 0.16), side * (HALF_WIDTH_M - 0.11)))
        paint(value, inside(forward, right, rectangle(1.2, outer, -1.9, inner), 0.01), 0.06)
    hatch = rectangle(1.30, 0.22, 0.98, -0.22)
    paint(value, inside(forward, right, hatch, TEXEL_M), GLASS)
    if deck_half_m < 0.95:
        deck = rectangle(deck_half_m, deck_half_m, -deck_half_m, -deck_half_m)
        grown = rectangle(*(1.02 * v for v in (deck_half_m, deck_half_m, -deck_half_m, -deck_half_m)))
        paint(value, 0.7 * inside(forward, right, grown, 0.03), 0.05)
        paint(value, inside(forward, right, deck, TEXEL_M), 0.21)
        for k in (-1.0, 1.0):
            bolt = 0.93 * deck_half_m
            for place in (rectangle(k * bolt + 0.012, bolt + 0.012, k * bolt - 0.012, bolt - 0.012),):
                paint(value, inside(forward, right, place, TEXEL_M), 0.05)
                paint(value, inside(forward, -right, place, TEXEL_M), 0.05)
    dirt = cv2.resize(
        source.standard_normal((forward.shape[0] // 16, forward.shape[1] // 16)).astype(np.float32),
        (forward.shape[1], forward.shape[0]),
        interpolation=cv2.INTER_CUBIC,
    )
    speckle = source.standard_normal(forward.shape).astype(np.float32)
    value *= 1.0 + 0.035 * dirt + 0.03 * speckle
    return decal(value, alpha, TEXEL_M, top, left)


def _bonnet() -> Decal:
    """Bonnet with creases, headlamps at its corners, the wipers' trough behind it."""
    forward, right, top, left = _canvas(NOSE_M, ROOF_FRONT_M + 0.5, HALF_WIDTH_M, 2 * TEXEL_M)
    texel = 2 * TEXEL_M
    nose = np.array(
        [
            [NOSE_M, -0.62],
            [NOSE_M, 0.62],
            [NOSE_M - 0.22, HALF_WIDTH_M - 0.06],
            [ROOF_FRONT_M + 0.55, HALF_WIDTH_M],
            [ROOF_FRONT_M + 0.55, -HALF_WIDTH_M],
            [NOSE_M - 0.22, -HALF_WIDTH_M + 0.06],
        ]
    )
    alpha = inside(forward, right, nose, texel)
    value = (PAINT * (1.0 - 0.25 * (right / HALF_WIDTH_M) ** 2)).astype(np.float32)
    paint(value, inside(forward, right, rectangle(ROOF_FRONT_M + 0.68, 0.9, ROOF_FRONT_M + 0.55, -0.9), 0.02), 0.03)
    for side in (-1.0, 1.0):
        inner, outer = sorted((side * 0.55, side * 0.575))
        crease = rectangle(NOSE_M - 0.15, outer, ROOF_FRONT_M + 0.7, inner)
        paint(value, 0.6 * inside(forward, right, crease, 0.01), PAINT * 0.55)
        inner, outer = sorted((side * 0.58, side * 0.86))
        paint(value, inside(forward, right, rectangle(NOSE_M - 0.06, outer, NOSE_M - 0.28, inner), 0.02), 0.55)
    return decal(value, alpha, texel, top, left)


def _screen() -> Decal:
    """Windscreen: dark glass with a streak of sky."""
    texel = 2 * TEXEL_M
    forward, right, top, left = _canvas(ROOF_FRONT_M + 0.62, ROOF_FRONT_M, HALF_WIDTH_M, texel)
    outline = np.array(
        [
            [ROOF_FRONT_M + 0.60, -HALF_WIDTH_M + 0.04],
            [ROOF_FRONT_M + 0.60, HALF_WIDTH_M - 0.04],
            [ROOF_FRONT_M + 0.02, HALF_WIDTH_M - 0.14],
            [ROOF_FRONT_M + 0.02, -HALF_WIDTH_M + 0.14],
        ]
    )
    alpha = inside(forward, right, outline, texel)
    value = np.full(forward.shape, GLASS, dtype=np.float32)
    streak = np.exp(-(((right - 0.35 + 0.5 * (forward - ROOF_FRONT_M)) / 0.16) ** 2))
    value += (0.10 * streak).astype(np.float32)
    return decal(value, alpha, texel, top, left)


def _shadow(height_m: float, sun_forward: float, sun_right: float) -> Decal:
    """Sun's shadow of the body on the road, and the gloom under it."""
    reach = height_m * max(abs(sun_forward), abs(sun_right)) + 0.6
    forward, right, top, left = _canvas(NOSE_M + reach, ROOF_BACK_M - reach, HALF_WIDTH_M + reach, SHADOW_TEXEL_M)
    away = np.array([-sun_forward, -sun_right]) * height_m
    body = rectangle(ROOF_FRONT_M + 0.3, HALF_WIDTH_M, ROOF_BACK_M, -HALF_WIDTH_M)
    low = rectangle(NOSE_M, HALF_WIDTH_M, ROOF_BACK_M, -HALF_WIDTH_M)
    points = np.vstack([body, body + away, low, low + BONNET_SHARE * away]).astype(np.float32)
    # OpenCV's hull runs clockwise in (x, y): with x forward and y right that is clockwise from above too.
    hull = cv2.convexHull(points, clockwise=False)[:, 0, :].astype(np.float64)
    cover = inside(forward, right, hull, 0.05)
    gloom = inside(forward, right, low, 0.5)
    alpha = np.maximum((1.0 - SHADE) * cover, 0.5 * gloom).astype(np.float32)
    return decal(None, alpha, SHADOW_TEXEL_M, top, left)


@lru_cache(maxsize=8)
def build_van(height_m: float, deck_m: float, sun: tuple[float, float], seed: int) -> Van:
    """The van under a pad.

    Args:
        height_m: Of the roof.
        deck_m: Side of the square that can be landed on.
        sun: Horizontal way to the sun over its height, along the pad's forward and right.
        seed: Of its dirt.
    """
    source = np.random.default_rng((seed, 23))
    body = np.array(
        [
            [NOSE_M, -0.62],
            [NOSE_M, 0.62],
            [NOSE_M - 0.22, HALF_WIDTH_M],
            [ROOF_BACK_M, HALF_WIDTH_M],
            [ROOF_BACK_M, -HALF_WIDTH_M],
            [NOSE_M - 0.22, -HALF_WIDTH_M],
        ]
    )
    return Van(
        Panel(_shadow(height_m, *sun), 0.0),
        body,
        height_m,
        (
            Panel(_bonnet(), BONNET_SHARE * height_m),
            Panel(_screen(), SCREEN_SHARE * height_m),
            Panel(_roof(deck_m / 2.0, source), height_m),
        ),
    )
