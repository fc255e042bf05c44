"""Small things in the scene: the lane's dashes and the vehicle's own shadow."""

from __future__ import annotations

import cv2
import numpy as np

from drivers.simulator.decals import Decal, decal, grid, inside, rectangle

PAINT = 0.50
LANE_PERIOD_M = 9.0
LANE_OFFSET_M = -2.2
"""To the left of the way that the pad drives."""
SHADE = 0.55
"""How much of the light the vehicle's shadow takes."""


def lane_mark() -> Decal:
    """A dash of 3 m by 12 cm, worn."""
    texel = 0.01
    forward, right = grid(320, 32, texel, 1.6, -0.16)
    source = np.random.default_rng(5)
    worn = 0.75 + 0.15 * cv2.GaussianBlur(source.standard_normal((320, 32)).astype(np.float32), (0, 0), 1.5)
    alpha = inside(forward, right, rectangle(1.5, 0.06, -1.5, -0.06), texel) * np.clip(worn, 0.0, 1.0)
    return decal(np.full(forward.shape, PAINT, dtype=np.float32), alpha.astype(np.float32), texel, 1.6, -0.16)


def drone_shadow() -> tuple[Decal, Decal]:
    """The vehicle's shadow, sharp (low over what it falls on) and soft."""
    texel, half = 0.005, 0.48
    forward, right = grid(192, 192, texel, half, -half)
    cover = inside(forward, right, rectangle(0.11, 0.07, -0.11, -0.07), texel)
    for side in (-1.0, 1.0):
        along, across = (forward + side * right) / np.sqrt(2.0), (right - side * forward) / np.sqrt(2.0)
        arm = inside(along.astype(np.float32), across.astype(np.float32), rectangle(0.24, 0.012, -0.24, -0.012), texel)
        cover = np.maximum(cover, arm)
        for end in (-0.22, 0.22):
            disc = np.hypot(along - end, across)
            # Turning blades let most of the light through.
            cover = np.maximum(cover, np.where(disc < 0.125, 0.35, 0.0))
            cover = np.maximum(cover, np.where(disc < 0.022, 1.0, 0.0))
    made = []
    for blur_m in (0.008, 0.03):
        alpha = SHADE * cv2.GaussianBlur(cover.astype(np.float32), (0, 0), blur_m / texel)
        made.append(decal(None, alpha.astype(np.float32), texel, half, -half))
    return made[0], made[1]
