"""The ground to the horizon and the sky above it, drawn from the seamless textures."""

from __future__ import annotations

import math

import cv2
import numpy as np

from drivers.simulator.textures import LAND_M, PATCH_M, SEAM_PX, STEP, TILE_M, TILE_PX, Plane, ground
from drivers.simulator.view import CLOSEST_M, Array, Camera, View

SKY = 0.45
COARSE = 4
"""Patches and haze are worked out on every fourth pixel."""
PATCH_TURN_RAD = 0.58
LAND_TURN_RAD = -0.37
"""The ground's tiles lie in different directions."""
DETAIL_STRETCH = 2.6
"""Slant (1 + slope^2) from which the texture's detail fades into its mean: a pixel covers several texels there."""
HAZE_FROM, HAZE_TO = 600.0, 2000.0
"""Slants between which the ground fades into the sky."""


class Landscape:
    """Draws the ground.

    Args:
        kind: "lawn" or "asphalt".
        seed: Of its textures.
        camera: That sees it.
    """

    def __init__(self, kind: str, seed: int, camera: Camera) -> None:
        self._textures = ground(kind, seed)
        self._camera = camera
        shape = camera.rays.shape[:2]
        self._light, self._u, self._v = (np.empty(shape, dtype=np.float32) for _ in range(3))

    def draw(self, view: View) -> Plane:
        """Light of the ground and sky, (height, width); valid until the next."""
        textures, lens, light = self._textures, self._camera.lens, self._light
        height_m = max(CLOSEST_M, view.height_m)
        level = round(2.0 * math.log2(height_m / lens.focal_px / (TILE_M / TILE_PX)))
        fine = textures.fine[max(0, min(len(textures.fine) - 1, level))]
        slopes = (view.north, view.east)
        _fold(slopes, (self._u, self._v), view.position, height_m, (TILE_M, fine.shape[0] - SEAM_PX, 0.0))
        drawn = cv2.remap(fine, self._u, self._v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        gain, lift = self._broad(view, height_m)
        size = (lens.width, lens.height)
        bright = cv2.resize(gain, size, interpolation=cv2.INTER_LINEAR)
        cv2.multiply(drawn, bright, dst=light, scale=STEP, dtype=cv2.CV_32F)
        if float(lift.max()) > 0.0:
            cv2.add(light, cv2.resize(lift, size, interpolation=cv2.INTER_LINEAR), dst=light)
        return light

    def _broad(self, view: View, height_m: float) -> tuple[Plane, Plane]:
        """What the fine texture is multiplied by, and what is added where it can't be seen, on coarse pixels."""
        textures, part = self._textures, slice(COARSE // 2, None, COARSE)
        slopes = tuple(np.ascontiguousarray(plane[part, part]) for plane in (view.north, view.east))
        at = (np.empty_like(slopes[0]), np.empty_like(slopes[0]))
        drawn = []
        for tile, size_m, turn in ((textures.patches, PATCH_M, PATCH_TURN_RAD), (textures.land, LAND_M, LAND_TURN_RAD)):
            _fold(slopes, at, view.position, height_m, (size_m, tile.shape[0] - SEAM_PX, turn))
            drawn.append(cv2.remap(tile, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        slant = 1.0 + slopes[0] * slopes[0] + slopes[1] * slopes[1]
        haze = np.clip((slant - HAZE_FROM) / (HAZE_TO - HAZE_FROM), 0.0, 1.0)
        scale = textures.reflectance * STEP * STEP
        broad = cv2.multiply(drawn[0], drawn[1], scale=scale, dtype=cv2.CV_32F) * (1.0 - haze)
        gain = broad * np.minimum(DETAIL_STRETCH / slant, 1.0)
        lift = broad - gain + SKY * haze
        return np.asarray(gain, dtype=np.float32), np.asarray(lift, dtype=np.float32)


def _fold(
    slopes: tuple[Plane, ...],
    out: tuple[Plane, Plane],
    position: Array,
    height_m: float,
    tile: tuple[float, int, float],
) -> None:
    """Texture coordinates under directions, of a square tile (size in m and in px, turn) that covers the ground."""
    size_m, size_px, turn = tile
    c, s = math.cos(turn), math.sin(turn)
    north, east = float(position[0]), float(position[1])
    k = height_m / size_m
    # Whole tiles are taken off: 32 bits don't hold a long way at a small texel.
    u0 = ((c * north + s * east) / size_m) % 1.0 - 0.5 / size_px
    v0 = ((-s * north + c * east) / size_m) % 1.0 - 0.5 / size_px
    for plane, a, b, shift in ((out[0], c * k, s * k, u0), (out[1], -s * k, c * k, v0)):
        # Folded into the tile here: OpenCV's own wrapping takes a slow path for every pixel outside.
        cv2.addWeighted(slopes[0], a, slopes[1], b, shift, dst=plane)
        plane -= np.floor(plane)
        plane *= np.float32(size_px)
