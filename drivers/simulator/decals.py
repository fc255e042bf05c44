"""Flat pictures that lie in the scene at a height of their own: shadows, the van's panels, the lane's line.

A decal holds (reflectance times alpha, what it lets through), so that what is under it shows where alpha is less than
1 and its rim is anti-aliased; and smaller copies of itself for the distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float32]

BLACK = 0.045
"""Reflectance of black print on paper."""
WHITE = 0.78


SAME_M = 1e-9
"""Corners nearer to each other than this are one."""
UNSEEN = 5e-4
"""Alpha that changes no grey level by as much as a tenth."""
FULL = 65535.0
"""A whole in a decal's 16 bits: half the memory of floats."""
Texels = NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class Decal:
    """A picture with its scale.

    Attributes:
        clear: (rows, columns) 1 - alpha, of FULL; each half the size of the one before; first row: front, first column:
            left.
        bright: (rows, columns) reflectance times alpha, of FULL, of the same sizes; none for what is black throughout
            (a shadow). A plane of its own: OpenCV warps two planes in the time of two channels padded to four, and
            what has to be fetched is half as much.
        texel_m: Of the first level.
        front_m: Where the front edge of the first row is, along the forward axis of the decal's frame.
        left_m: Where the left edge of the first column is, along the right axis (negative: to the left).
        rim_m: (n, 2) forward, right of points round what can be seen of it.
    """

    clear: tuple[Texels, ...]
    bright: tuple[Texels, ...]
    texel_m: float
    front_m: float
    left_m: float
    rim_m: NDArray[np.float64]


def _levels(plane: NDArray[np.floating[Any]]) -> tuple[Texels, ...]:
    levels = [plane.astype(np.float32)]
    while min(levels[-1].shape) >= 8 and all(side % 2 == 0 for side in levels[-1].shape):
        rows, columns = levels[-1].shape
        half = cv2.resize(levels[-1], (columns // 2, rows // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(half, dtype=np.float32))
    return tuple(np.round(np.clip(level, 0.0, 1.0) * FULL).astype(np.uint16) for level in levels)


def outline(corners: NDArray[np.float64], parts: int = 8) -> NDArray[np.float64]:
    """(n * parts, 2) points along the sides of a polygon (n, 2): enough for a lens that bends them."""
    steps = np.linspace(0.0, 1.0, parts + 1)[:-1, None]
    following = np.roll(corners, -1, axis=0)
    return np.vstack([a + steps * (b - a) for a, b in zip(corners, following, strict=True)])


def decal(value: Plane | None, alpha: Plane, texel_m: float, front_m: float, left_m: float) -> Decal:
    """A decal of a reflectance (None: a shadow) and an alpha (rows, columns), with its smaller copies."""
    bright = () if value is None else _levels(value * alpha)
    rim = outline(_octagon(alpha, texel_m, front_m, left_m))
    return Decal(_levels(1.0 - alpha), bright, texel_m, front_m, left_m, rim)


def _octagon(alpha: Plane, texel_m: float, front_m: float, left_m: float) -> NDArray[np.float64]:
    """(4 to 8, 2) forward, right of corners about what can be seen: most canvases are clear towards their corners."""
    there = alpha > UNSEEN
    row = np.nonzero(there.any(axis=1))[0]
    # The first and the last texel of each row bound all between.
    first, last = there[row].argmax(axis=1), alpha.shape[1] - 1 - there[row, ::-1].argmax(axis=1)
    rows, columns = np.concatenate([row, row]), np.concatenate([first, last])
    seen = np.column_stack([front_m - (rows + 0.5) * texel_m, left_m + (columns + 0.5) * texel_m])
    angle = np.arange(8) * math.pi / 4.0
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    # Half a texel's diagonal more, for what a texel's own corners reach.
    reach = (seen @ normal.T).max(axis=0) + 0.71 * texel_m
    # Each corner lies where one side meets the next, an eighth of a turn on.
    along = (np.roll(reach, -1) - reach * math.cos(math.pi / 4.0)) / math.sin(math.pi / 4.0)
    corners = reach[:, None] * normal + along[:, None] * np.column_stack([-normal[:, 1], normal[:, 0]])
    length = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    apart: NDArray[np.float64] = corners[length > SAME_M]
    return apart


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
    result: Plane = np.clip(nearest / np.float32(soft_m) + 0.5, 0.0, 1.0).astype(np.float32)
    return result


def rectangle(front: float, right: float, back: float, left: float) -> NDArray[np.float64]:
    """(4, 2) corners, clockwise from above."""
    return np.array([[front, left], [front, right], [back, right], [back, left]])


def paint(value: Plane, cover: Plane, shade: float) -> None:
    """Paint a shade over a picture where it is covered."""
    value += cover * (np.float32(shade) - value)
