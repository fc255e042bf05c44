"""Flat pictures that lie in the scene at a height of their own: the landmark's board, shadows, the van's panels.

A decal holds (reflectance times alpha, alpha), so that what is under it shows where alpha is less than 1 and its rim
is anti-aliased; and smaller copies of itself for the distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.landmark import Landmark

Plane = NDArray[np.float32]

BLACK = 0.045
"""Reflectance of black print on paper."""
WHITE = 0.78
BOARD_MARGIN = 1.30
"""The landmark's picture is this much wider than its quiet zone, for the board's shadow."""
BOARD_THICKNESS_M = 0.015
LANDMARK_TEXELS = 1536


@dataclass(frozen=True, slots=True)
class Decal:
    """A picture with its scale.

    Attributes:
        levels: (rows, columns, 2) each half the size of the one before; first row: front, first column: left.
        texel_m: Of the first level.
        front_m: Where the front edge of the first row is, along the forward axis of the decal's frame.
        left_m: Where the left edge of the first column is, along the right axis (negative: to the left).
    """

    levels: tuple[Plane, ...]
    texel_m: float
    front_m: float
    left_m: float

    @property
    def corners_m(self) -> NDArray[np.float64]:
        """(4, 2) forward, right of its rim."""
        rows, columns = self.levels[0].shape[:2]
        back, right = self.front_m - rows * self.texel_m, self.left_m + columns * self.texel_m
        return np.array([[self.front_m, self.left_m], [self.front_m, right], [back, right], [back, self.left_m]])


def decal(value: Plane, alpha: Plane, texel_m: float, front_m: float, left_m: float) -> Decal:
    """A decal of a reflectance and an alpha (rows, columns), with its smaller copies."""
    level: Plane = np.dstack([value * alpha, alpha]).astype(np.float32)
    levels = [level]
    while min(levels[-1].shape[:2]) >= 8 and all(side % 2 == 0 for side in levels[-1].shape[:2]):
        rows, columns = levels[-1].shape[:2]
        half = cv2.resize(levels[-1], (columns // 2, rows // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.ascontiguousarray(half, dtype=np.float32))
    return Decal(tuple(levels), texel_m, front_m, left_m)


def grid(rows: int, columns: int, texel_m: float, front_m: float, left_m: float) -> tuple[Plane, Plane]:
    """(forward, right) of the texel centres."""
    forward = front_m - (np.arange(rows, dtype=np.float32)[:, None] + 0.5) * texel_m
    right = left_m + (np.arange(columns, dtype=np.float32)[None, :] + 0.5) * texel_m
    shape = (rows, columns)
    return np.broadcast_to(forward, shape).astype(np.float32), np.broadcast_to(right, shape).astype(np.float32)


def inside(forward: Plane, right: Plane, corners: NDArray[np.float64], soft_m: float) -> Plane:
    """Coverage 0..1 of a convex polygon (n, 2) given clockwise from above, its edge soft over soft_m.

    With soft_m one texel this is the area that the polygon covers of each texel (exact on straight edges).
    """
    nearest = np.full(forward.shape, np.inf, dtype=np.float32)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along, across = float(b[0] - a[0]), float(b[1] - a[1])
        length = math.hypot(along, across)
        # Plain floats keep the arrays at 32 bits. The inward normal of a clockwise edge (f, r) is (-r, f).
        offset = (-across * float(a[0]) + along * float(a[1])) / length
        distance = (-across / length) * forward + (along / length) * right - offset
        np.minimum(nearest, distance, out=nearest)
    return np.clip(nearest / np.float32(soft_m) + 0.5, 0.0, 1.0).astype(np.float32)


def rectangle(front: float, right: float, back: float, left: float) -> NDArray[np.float64]:
    """(4, 2) corners, clockwise from above."""
    return np.array([[front, left], [front, right], [back, right], [back, left]])


def landmark_decal(landmark: Landmark, sun_forward: float, sun_right: float) -> Decal:
    """The printed landmark on its board, in the pad frame.

    Args:
        landmark: What is printed.
        sun_forward: Horizontal way to the sun over its height (cot of its elevation), along the pad's forward.
        sun_right: The same along the pad's right.
    """
    half = landmark.quiet_zone_m * BOARD_MARGIN / 2.0
    texel = 2.0 * half / LANDMARK_TEXELS
    forward, right = grid(LANDMARK_TEXELS, LANDMARK_TEXELS, texel, half, -half)
    zone = landmark.quiet_zone_m / 2.0
    board = inside(forward, right, rectangle(zone, zone, -zone, -zone), texel)
    value = np.full(forward.shape, WHITE, dtype=np.float32)
    for contour in landmark.contours:
        cover = inside(forward, right, contour.corners_m, texel)
        value += cover * (np.float32(BLACK if contour.black else WHITE) - value)
    # The board's own shadow falls away from the sun; round all of it the light is a little less.
    away = (-sun_forward * BOARD_THICKNESS_M, -sun_right * BOARD_THICKNESS_M)
    shadow = inside(forward - away[0], right - away[1], rectangle(zone, zone, -zone, -zone), 0.006)
    gloom = inside(forward, right, rectangle(zone, zone, -zone, -zone), 0.05)
    alpha = np.maximum(board, np.maximum(0.55 * shadow, 0.22 * gloom))
    light = np.where(alpha > 0.0, board / np.maximum(alpha, 1e-6), 0.0)
    return decal((value * light).astype(np.float32), alpha, texel, half, -half)
