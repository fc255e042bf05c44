"""The boat that carries the pad: its deck as a decal on the deck's plane, its sides down to the water.

Its frame is the pad's: forward, right, from the landmark's centre, which lies over the middle of the landing deck.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drivers.simulator.decals import Decal, decal, grid, inside, paint, rectangle

TEXEL_M = 0.01
PAINT = 0.42
"""Reflectance of the anti-slip paint; the landing square is darker, the rail and cabin top lighter."""
SIDE = 0.20
BEAM_SHARE = 0.75
"""Half the beam over the side of the landing square."""


@dataclass(frozen=True, slots=True)
class Boat:
    """The whole boat.

    Attributes:
        deck: On the deck's plane.
        outline: (n, 2) forward, right, of the deck's rim, clockwise from above.
    """

    deck: Decal
    outline: NDArray[np.float64]


@lru_cache(maxsize=4)
def build_boat(deck_m: float, seed: int) -> Boat:
    """The boat under a pad.

    Args:
        deck_m: Side of the square that can be landed on.
        seed: Of its wear.
    """
    source = np.random.default_rng((seed, 29))
    half, beam = deck_m / 2.0, BEAM_SHARE * deck_m
    bow, stern = half + 1.6 * deck_m, -half - 0.4 * deck_m
    rim = np.array(
        [
            [bow, 0.0],
            [bow - 0.5 * deck_m, 0.62 * beam],
            [half, beam],
            [stern, 0.92 * beam],
            [stern, -0.92 * beam],
            [half, -beam],
            [bow - 0.5 * deck_m, -0.62 * beam],
        ]
    )
    rows, columns = (int(np.ceil(size / TEXEL_M / 32.0)) * 32 for size in (bow - stern + 0.1, 2.0 * beam + 0.1))
    top, left = (bow + stern + rows * TEXEL_M) / 2.0, -columns * TEXEL_M / 2.0
    forward, right = grid(rows, columns, TEXEL_M, top, left)
    alpha = inside(forward, right, rim, TEXEL_M)
    value = np.full(forward.shape, 0.62, dtype=np.float32)
    paint(value, inside(forward, right, 0.96 * rim, TEXEL_M), PAINT)
    square = rectangle(half, half, -half, -half)
    paint(value, inside(forward, right, square, TEXEL_M), 0.16)
    for line in (0.97, 0.93):
        paint(value, inside(forward, right, line * square, TEXEL_M), 0.5 if line == 0.97 else 0.16)
    cabin = rectangle(half + 0.95 * deck_m, 0.55 * beam, half + 0.15 * deck_m, -0.55 * beam)
    paint(value, inside(forward, right, cabin, TEXEL_M), 0.58)
    paint(value, inside(forward, right, 0.9 * (cabin - cabin.mean(axis=0)) + cabin.mean(axis=0), TEXEL_M), 0.5)
    value *= 1.0 + 0.05 * source.standard_normal(value.shape).astype(np.float32)
    return Boat(decal(value, alpha, TEXEL_M, top, left), rim)
