"""The lens: points of the camera frame to pixels and back, with derivatives. Only points are undistorted, never images.

Two models, each in OpenCV's convention: `pinhole` (x/z, y/z with k1 k2 p1 p2 k3) and `equidistant` (radius in the image
proportional to the angle from the axis, with k1..k4, as cv2.fisheye). Sources: Brown, "Close-range camera calibration",
1971; Kannala and Brandt, "A generic camera model and calibration method", 2006.
Pixel centres are at whole numbers. It knows nothing of the landmark or of where the camera is mounted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.config import LensConfig
from app.frames import Array

NEWTON_STEPS = 20
CONVERGED = 1e-12


class Lens(Protocol):
    """What the rest of the vision asks of a lens."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of its images."""
        ...

    @property
    def focal_px(self) -> float:
        """Pixels per radian on the axis, the mean of both directions."""
        ...

    def project(self, points_cam: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Points (n, 3) of the camera frame to pixels (n, 2), and whether the lens can see each at all (n,).

        A pixel may lie outside the image; that of an invalid point is not a number.
        """
        ...

    def project_with_jacobian(self, points_cam: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """As project, with d pixel / d point (n, 2, 3) in between."""
        ...

    def rays(self, px: Array) -> Array:
        """Pixels (n, 2) to unit vectors (n, 3) of the camera frame; not a number where no ray gives that pixel."""
        ...


@dataclass(frozen=True, slots=True)
class _Sensor:
    """Size and the affine part that both models share.

    Attributes:
        size_px: Width, height.
        focal: (2,) focal lengths across and down.
        centre: (2,) principal point.
        focal_px: Mean of the focal lengths.
    """

    size_px: tuple[int, int]
    focal: Array
    centre: Array
    focal_px: float


def _first_positive_root(coefficients: list[float], limit: float) -> float:
    """Smallest positive real root of sum c[k] r^(2k), at most `limit`: where a radial polynomial turns back."""
    while len(coefficients) > 1 and coefficients[-1] == 0.0:
        coefficients = coefficients[:-1]
    if len(coefficients) == 1:
        return limit
    roots = np.roots(coefficients[::-1])
    real = [math.sqrt(z.real) for z in roots if abs(z.imag) < 1e-9 and z.real > 0]
    return min([limit, *real])


@dataclass(frozen=True, slots=True)
class PinholeLens(_Sensor):
    """x/z and y/z with Brown's distortion.

    Attributes:
        k: (k1, k2, p1, p2, k3).
        radius_max: Largest undistorted radius at which the distortion still grows with the radius.
    """

    k: tuple[float, float, float, float, float]
    radius_max: float

    def _distort(self, x: Array, y: Array) -> tuple[Array, Array]:
        k1, k2, p1, p2, k3 = self.k
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )

    def _slopes(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Derivatives of the distortion: d xd/dx, d xd/dy (which is d yd/dx) and d yd/dy."""
        k1, k2, p1, p2, k3 = self.k
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)
        xx = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        yy = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        return xx, xy, yy

    def project(self, points_cam: Array) -> tuple[Array, NDArray[np.bool_]]:
        """See Lens."""
        z = points_cam[:, 2]
        valid = z > 1e-9
        xy = points_cam[:, :2] / np.where(valid, z, 1.0)[:, None]
        if self.k != (0.0,) * 5:
            valid = valid & (np.hypot(xy[:, 0], xy[:, 1]) < self.radius_max)
            xy = np.column_stack(self._distort(xy[:, 0], xy[:, 1]))
        px = xy * self.focal + self.centre
        if not valid.all():
            px[~valid] = np.nan
        return px, valid

    def project_with_jacobian(self, points_cam: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """See Lens."""
        px, valid = self.project(points_cam)
        iz = 1.0 / np.where(valid, points_cam[:, 2], 1.0)
        x, y = points_cam[:, 0] * iz, points_cam[:, 1] * iz
        if self.k != (0.0,) * 5:
            xx, xy, yy = self._slopes(x, y)
        else:
            xx, xy, yy = np.ones_like(x), np.zeros_like(x), np.ones_like(x)
        jac = np.empty((len(x), 2, 3))
        fx, fy = self.focal
        jac[:, 0, 0], jac[:, 0, 1], jac[:, 0, 2] = fx * xx * iz, fx * xy * iz, -fx * (xx * x + xy * y) * iz
        jac[:, 1, 0], jac[:, 1, 1], jac[:, 1, 2] = fy * xy * iz, fy * yy * iz, -fy * (xy * x + yy * y) * iz
        return px, jac, valid

    def rays(self, px: Array) -> Array:
        """See Lens. Newton's method on both coordinates, all points at once."""
        xd, yd = ((px - self.centre) / self.focal).T
        x, y = xd.copy(), yd.copy()
        if self.k != (0.0,) * 5:
            radius = np.hypot(x, y)
            shrink = np.minimum(1.0, 0.95 * self.radius_max / np.maximum(radius, 1e-12))
            x, y = x * shrink, y * shrink
            for _ in range(NEWTON_STEPS):
                ex, ey = self._distort(x, y)
                ex, ey = ex - xd, ey - yd
                xx, xy, yy = self._slopes(x, y)
                det = xx * yy - xy * xy
                det = np.where(np.abs(det) < 1e-9, 1e-9, det)
                dx, dy = (yy * ex - xy * ey) / det, (xx * ey - xy * ex) / det
                x, y = x - dx, y - dy
                if max(np.max(np.abs(dx), initial=0.0), np.max(np.abs(dy), initial=0.0)) < CONVERGED:
                    break
            ex, ey = self._distort(x, y)
            lost = ~((np.hypot(ex - xd, ey - yd) < 1e-6) & (np.hypot(x, y) <= self.radius_max))
            x = np.where(lost, np.nan, x)
        norm = np.sqrt(x * x + y * y + 1.0)
        return np.column_stack([x / norm, y / norm, 1.0 / norm])


@dataclass(frozen=True, slots=True)
class EquidistantLens(_Sensor):
    """Radius theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) for the angle theta from the axis.

    Attributes:
        k: (k1, k2, k3, k4).
        theta_max_rad: Largest angle at which the radius still grows with the angle.
    """

    k: tuple[float, float, float, float]
    theta_max_rad: float

    def _radius(self, theta: Array) -> Array:
        k1, k2, k3, k4 = self.k
        t2 = theta * theta
        return theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))

    def _slope(self, theta: Array) -> Array:
        k1, k2, k3, k4 = self.k
        t2 = theta * theta
        return 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))

    def project(self, points_cam: Array) -> tuple[Array, NDArray[np.bool_]]:
        """See Lens. The angle may be over 90 degrees."""
        x, y, z = points_cam.T
        rho = np.sqrt(x * x + y * y)
        theta = np.arctan2(rho, z)
        bent = theta if self.k == (0.0,) * 4 else self._radius(theta)
        # On the axis radius / rho tends to 1 / z; behind the camera there is no such limit.
        on_axis = rho < 1e-12
        scale = np.where(on_axis, 1.0 / np.where(z > 0, z, 1.0), bent / np.where(on_axis, 1.0, rho))
        px: Array = points_cam[:, :2] * scale[:, None] * self.focal + self.centre
        valid = (theta < self.theta_max_rad) & ((z > 0) | ~on_axis)
        if not valid.all():
            px[~valid] = np.nan
        return px, valid

    def project_with_jacobian(self, points_cam: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """See Lens."""
        x, y, z = np.ascontiguousarray(points_cam.T)
        rho2 = x * x + y * y
        n2 = rho2 + z * z
        small = rho2 < 1e-16
        rho = np.sqrt(np.where(small, 1.0, rho2))
        theta = np.arctan2(np.where(small, 0.0, rho), z)
        straight = self.k == (0.0,) * 4
        on_axis = np.where(small & (z != 0.0), z, 1.0)
        g = np.where(small, 1.0 / on_axis, (theta if straight else self._radius(theta)) / rho)
        slope = 1.0 if straight else self._slope(theta)
        # u = g(rho, z) x: dg/dx = x/rho (slope z / (rho n2) - g / rho), dg/dz = -slope / n2.
        n2 = np.where(n2 > 0.0, n2, 1.0)
        dg = np.where(small, 0.0, (slope * z / n2 - g) / np.where(small, 1.0, rho2))
        xy = points_cam[:, :2]
        jac = np.empty((len(x), 2, 3))
        jac[:, :, :2] = xy[:, :, None] * (xy * dg[:, None])[:, None, :]
        jac[:, 0, 0] += g
        jac[:, 1, 1] += g
        jac[:, :, 2] = xy * (-slope / n2)[:, None]
        jac *= self.focal[:, None]
        px = xy * g[:, None] * self.focal + self.centre
        valid = (theta < self.theta_max_rad) & ((z > 0) | ~small)
        if not valid.all():
            px[~valid] = np.nan
        return px, jac, valid

    def rays(self, px: Array) -> Array:
        """See Lens. Newton's method on the angle, all points at once."""
        xy = (px - self.centre) / self.focal
        radius = np.sqrt(xy[:, 0] * xy[:, 0] + xy[:, 1] * xy[:, 1])
        theta = radius
        if self.k != (0.0,) * 4:
            theta = np.minimum(radius, self.theta_max_rad)
            for _ in range(NEWTON_STEPS):
                step = (self._radius(theta) - radius) / np.maximum(self._slope(theta), 1e-6)
                theta = np.clip(theta - step, 0.0, self.theta_max_rad)
                if np.max(np.abs(step), initial=0.0) < CONVERGED:
                    break
            theta = np.where(np.abs(self._radius(theta) - radius) < 1e-6, theta, np.nan)
        theta = np.where(theta <= self.theta_max_rad, theta, np.nan)
        out = np.empty((len(xy), 3))
        out[:, :2] = xy * np.where(radius < 1e-12, 1.0, np.sin(theta) / np.maximum(radius, 1e-12))[:, None]
        out[:, 2] = np.cos(theta)
        return out


def lens_from_config(config: LensConfig) -> Lens:
    """The lens that a camera file describes."""
    size = (config.width_px, config.height_px)
    focal = np.array([config.fx_px, config.fy_px])
    centre = np.array([config.cx_px, config.cy_px])
    mean = 0.5 * (config.fx_px + config.fy_px)
    k = tuple(config.distortion)
    if config.model == "pinhole":
        k1, k2, p1, p2, k3 = (*k, *(0.0,) * (5 - len(k)))
        radius_max = _first_positive_root([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3], 1e6)
        return PinholeLens(size, focal, centre, mean, (k1, k2, p1, p2, k3), radius_max)
    k1, k2, k3, k4 = (*k, *(0.0,) * (4 - len(k)))
    theta_max = _first_positive_root([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4], math.pi * 0.999)
    return EquidistantLens(size, focal, centre, mean, (k1, k2, k3, k4), theta_max)


def tangent_basis(ray: Array) -> Array:
    """(3, 3) rotation tangent_from_cam whose third row is the unit vector `ray`: a virtual camera that looks along it.

    Straight lines of the world are straight on its image plane, whatever the lens does to them.
    """
    x, y, z = (float(v) for v in ray)
    norm = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / norm, y / norm, z / norm
    # Its right is level with the image's rows, unless it looks along the image's columns.
    if abs(y) < 0.9:
        rx, ry, rz = z, 0.0, -x
    else:
        rx, ry, rz = 0.0, -z, y
    length = math.sqrt(rx * rx + ry * ry + rz * rz)
    rx, ry, rz = rx / length, ry / length, rz / length
    return np.array([[rx, ry, rz], [y * rz - z * ry, z * rx - x * rz, x * ry - y * rx], [x, y, z]])
