"""The lens that the simulated camera looks through, written from geometry: directions of pixels, pixels of points.

Camera axes: right in the image, down in the image, into the scene. Pixel centres are at whole numbers.
Pinhole: Brown's distortion (k1 k2 p1 p2 k3) of the tangents x/z, y/z. Equidistant: radius = f (theta + k1 theta^3 +
k2 theta^5 + k3 theta^7 + k4 theta^9) (Kannala and Brandt 2006), which reaches past 90 degrees.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.config import LensConfig

Array = NDArray[np.float64]

NEWTON_STEPS = 25
ANGLE_MAX_RAD = math.radians(120.0)
"""Nothing is drawn further off the axis."""


class Lens:
    """One lens.

    Attributes:
        width: Of the image, px.
        height: Of the image, px.
        focal_px: Mean focal length at the centre: px per radian.
    """

    def __init__(self, config: LensConfig) -> None:
        self._config = config
        self.width, self.height = config.width_px, config.height_px
        self.focal_px = math.sqrt(config.fx_px * config.fy_px)
        k = tuple(config.distortion)
        self._k = k + (0.0,) * ((5 if config.model == "pinhole" else 4) - len(k))

    def project(self, points: Array) -> Array:
        """(n, 2) pixels u, v of points (n, 3) in the camera's axes; NaN where the lens doesn't see them."""
        x, y, z = np.asarray(points, dtype=np.float64).T
        c = self._config
        result = np.empty((len(x), 2))
        if c.model == "pinhole":
            seen = z > 1e-9
            depth = np.where(seen, z, np.nan)
            a, b = self._brown(x / depth, y / depth)
        else:
            # On the axis the scale is that of a very small angle: the lens is straight there.
            side = np.maximum(np.hypot(x, y), 1e-12)
            theta = np.arctan2(side, z)
            scale = self._radius(theta) / side
            if theta.max(initial=0.0) >= ANGLE_MAX_RAD:
                scale = np.where(theta < ANGLE_MAX_RAD, scale, np.nan)
            a, b = x * scale, y * scale
        result[:, 0], result[:, 1] = c.fx_px * a + c.cx_px, c.fy_px * b + c.cy_px
        return result

    def rays(self) -> NDArray[np.float32]:
        """(height, width, 3) unit directions of the pixel centres."""
        c = self._config
        u, v = np.meshgrid(np.arange(c.width_px, dtype=np.float64), np.arange(c.height_px, dtype=np.float64))
        a, b = (u - c.cx_px) / c.fx_px, (v - c.cy_px) / c.fy_px
        if c.model == "pinhole":
            x, y = self._undistort(a, b)
            norm = np.sqrt(x * x + y * y + 1.0)
            return np.dstack([x / norm, y / norm, 1.0 / norm]).astype(np.float32)
        radius = np.hypot(a, b)
        theta = self._angle(radius)
        side = np.where(radius > 1e-12, np.sin(theta) / np.maximum(radius, 1e-12), 1.0)
        return np.dstack([a * side, b * side, np.cos(theta)]).astype(np.float32)

    @staticmethod
    def pixel_angle(rays: NDArray[np.float32]) -> NDArray[np.float32]:
        """(height, width) square root of each pixel's solid angle, rad, of directions (height, width, 3)."""
        down, across = np.gradient(rays.astype(np.float64), axis=(0, 1))
        area = np.linalg.norm(np.cross(across, down), axis=2)
        result: NDArray[np.float32] = np.sqrt(np.maximum(area, 1e-12)).astype(np.float32)
        return result

    def _brown(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Distorted tangents of undistorted ones."""
        if not any(self._k):
            return x, y
        k1, k2, p1, p2, k3 = self._k
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        )

    def _undistort(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Undistorted tangents, by fixed point iteration on Brown's equations."""
        k1, k2, p1, p2, k3 = self._k
        x, y = a.copy(), b.copy()
        for _ in range(NEWTON_STEPS if any(self._k) else 0):
            r2 = x * x + y * y
            radial = np.maximum(0.05, 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)))
            x = (a - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial
            y = (b - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial
        return x, y

    def _radius(self, theta: Array) -> Array:
        """Radius over f of an angle off the axis."""
        if not any(self._k):
            return theta
        k1, k2, k3, k4 = self._k
        t2 = theta * theta
        result: Array = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        return result

    def _angle(self, radius: Array) -> Array:
        """Angle off the axis of a radius over f, by Newton's method."""
        k1, k2, k3, k4 = self._k
        theta = np.minimum(radius, ANGLE_MAX_RAD)
        for _ in range(NEWTON_STEPS if any(self._k) else 0):
            t2 = theta * theta
            slope = 1.0 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
            theta = np.clip(theta - (self._radius(theta) - radius) / np.maximum(slope, 0.05), 0.0, ANGLE_MAX_RAD)
        return theta
