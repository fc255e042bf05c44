"""The benchmark's two lenses, from geometry alone: what a pixel looks at, and where a point is seen.

Camera frame: right, down, into the scene; pixel centres at whole numbers. It shares no code with the application's
camera model, so that an error in one shows against the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

WIDTH, HEIGHT = 640, 480
CENTRE = np.array([319.5, 239.5])
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Optics:
    """One lens without distortion.

    Attributes:
        name: "A" or "B".
        fisheye: Radius proportional to the angle from the axis (equidistant); else to its tangent (pinhole).
        f: Pixels per radian on the axis.
    """

    name: str
    fisheye: bool
    f: float

    @property
    def camera_file(self) -> Path:
        """The same lens as a camera file for the application."""
        return HERE / f"camera-{self.name.lower()}.toml"

    def rays(self, px: Array) -> Array:
        """(n, 3) unit vectors of pixels (n, 2)."""
        xy = (np.asarray(px, dtype=np.float64) - CENTRE) / self.f
        radius = np.hypot(xy[..., 0], xy[..., 1])
        if not self.fisheye:
            z = 1.0 / np.sqrt(1.0 + radius**2)
            return np.concatenate([xy * z[..., None], z[..., None]], axis=-1)
        scale = np.sinc(radius / math.pi)  # sin(r) / r
        return np.concatenate([xy * scale[..., None], np.cos(radius)[..., None]], axis=-1)

    def project(self, points: Array) -> Array:
        """(n, 2) pixels of points (n, 3) of the camera frame; not a number where the lens can't see the point."""
        points = np.asarray(points, dtype=np.float64)
        side = np.hypot(points[:, 0], points[:, 1])
        z = points[:, 2]
        if self.fisheye:
            radius = np.arctan2(side, z)
            px = CENTRE + self.f * points[:, :2] * (radius / np.maximum(side, 1e-12))[:, None]
            return np.where((radius < 3.1)[:, None], px, np.nan)
        ahead = z > 1e-6
        px = CENTRE + self.f * points[:, :2] / np.where(ahead, z, 1.0)[:, None]
        return np.where(ahead[:, None], px, np.nan)

    @cached_property
    def grid(self) -> Array:
        """(HEIGHT + 2, WIDTH + 2, 3) float32 rays of every pixel and of a rim of one pixel."""
        u, v = np.meshgrid(np.arange(-1, WIDTH + 1), np.arange(-1, HEIGHT + 1))
        return self.rays(np.stack([u, v], axis=-1)).astype(np.float32)

    @cached_property
    def px_per_rad(self) -> Array:
        """(HEIGHT + 2, WIDTH + 2) float32: square root of the pixels per steradian."""
        z = self.grid[..., 2].astype(np.float64)
        if not self.fisheye:
            return (self.f * z**-1.5).astype(np.float32)
        angle = np.arccos(np.clip(z, -1.0, 1.0))
        return (self.f / np.sqrt(np.sinc(angle / math.pi))).astype(np.float32)

    def shading(self, strength: float) -> Array:
        """(HEIGHT, WIDTH) float32 fall-off towards the corners: 1 on the axis, 1 - strength at the corners."""
        u, v = np.meshgrid(np.arange(WIDTH) - CENTRE[0], np.arange(HEIGHT) - CENTRE[1])
        r2 = (u**2 + v**2) / float(CENTRE @ CENTRE)
        return np.asarray(1.0 - strength * r2, np.float32)


@lru_cache
def lens(name: str) -> Optics:
    """Lens A (equidistant, 215 px/rad) or B (pinhole, 495 px)."""
    return {"A": Optics("A", True, 215.0), "B": Optics("B", False, 495.0)}[name]


def inside(px: Array, margin: float = 0.0) -> Array:
    """(n,) whether pixels (n, 2) lie in the image, edges of the outermost pixels included."""
    low, high = -0.5 + margin, -0.5 - margin
    u, v = px[:, 0], px[:, 1]
    return np.asarray((u >= low) & (v >= low) & (u <= WIDTH + high) & (v <= HEIGHT + high))
