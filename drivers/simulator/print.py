"""The printed landmark, drawn edge by edge at every distance: each pixel takes the share of black that it covers.

A contour is convex: the distance of a point from it is the least of the distances from its sides, and the distance
from a side is linear on the pad's plane. Divided by what a pixel measures there it gives the area covered, exact for a
straight edge across square pixels, so edges fall where they are to a few hundredths of a pixel, near and far.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from app.landmark import Landmark
from drivers.simulator.decals import BLACK, WHITE, Decal, decal, grid, inside, outline, rectangle
from drivers.simulator.textures import Plane

BOARD_MARGIN = 1.30
"""The board's shadow is drawn in a square this much wider than the quiet zone."""
BOARD_THICKNESS_M = 0.015
SHADOW_TEXELS = 256


@dataclass(frozen=True, slots=True)
class Layer:
    """One contour, or the board under them.

    Attributes:
        rim_m: (n, 2) forward, right of points round it.
        sides: (m, 3): a, b, c of each side, for the distance a forward + b right + c, positive inside.
        reflectance: Of its inside.
    """

    rim_m: NDArray[np.float64]
    sides: NDArray[np.float64]
    reflectance: float


def print_layer(corners: NDArray[np.float64], reflectance: float) -> Layer:
    """A convex polygon (n, 2) forward, right, clockwise from above."""
    sides = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along, across = b - a
        length = math.hypot(along, across)
        normal = np.array([-across, along]) / length
        sides.append([normal[0], normal[1], -float(normal @ a)])
    return Layer(outline(corners), np.array(sides), reflectance)


def print_layers(landmark: Landmark) -> tuple[Layer, ...]:
    """The board, then the contours from the outside in."""
    half = landmark.quiet_zone_m / 2.0
    board = print_layer(rectangle(half, half, -half, -half), WHITE)
    return (board, *(print_layer(c.corners_m, BLACK if c.black else WHITE) for c in landmark.contours))


def paint_layer(
    light: Plane, layer: Layer, slopes: tuple[Plane, Plane], scale: NDArray[np.float64], per_pixel: Plane
) -> None:
    """Paint a layer over a piece of the picture.

    Args:
        light: What is there; changed.
        layer: What is painted.
        slopes: North and east per metre down of the piece's pixels.
        scale: (3, 3) View.on_plane of the pad.
        per_pixel: One over what a pixel measures on the pad's plane, and over the depth of a tilted one, 1/m.
    """
    nearest, distance = np.empty_like(light), np.empty_like(light)
    for k, (a, b, c) in enumerate(layer.sides):
        north, east, rest = (float(v) for v in a * scale[0] + b * scale[1] + c * scale[2])
        cv2.addWeighted(slopes[0], north, slopes[1], east, rest, dst=distance if k else nearest)
        if k:
            cv2.min(nearest, distance, dst=nearest)
    # The share covered is nearest * per_pixel + 0.5, from 0 to 1.
    cv2.multiply(nearest, per_pixel, dst=nearest)
    np.clip(nearest, -0.5, 0.5, out=nearest)
    np.subtract(np.float32(layer.reflectance), light, out=distance)
    nearest += np.float32(0.5)
    cv2.multiply(nearest, distance, dst=nearest)
    light += nearest


def board_shadow(landmark: Landmark, sun_forward: float, sun_right: float) -> Decal:
    """What the board takes of the light round it.

    Args:
        landmark: On the board.
        sun_forward: Horizontal way to the sun over its height (cot of its elevation), along the pad's forward.
        sun_right: The same along the pad's right.
    """
    return _square_shadow(landmark.quiet_zone_m, sun_forward, sun_right)


@lru_cache(maxsize=64)
def _square_shadow(zone_m: float, sun_forward: float, sun_right: float) -> Decal:
    """Of a board of this side."""
    half = zone_m * BOARD_MARGIN / 2.0
    texel = 2.0 * half / SHADOW_TEXELS
    forward, right = grid(SHADOW_TEXELS, SHADOW_TEXELS, texel, half, -half)
    zone = zone_m / 2.0
    square = rectangle(zone, zone, -zone, -zone)
    away = np.array([-sun_forward, -sun_right]) * BOARD_THICKNESS_M
    alpha = np.maximum(0.55 * inside(forward, right, square + away, 0.006), 0.22 * inside(forward, right, square, 0.05))
    return decal(None, alpha.astype(np.float32), texel, half, -half)
