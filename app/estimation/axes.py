"""Rotations by two axes, and vectors of three as tuples of floats: numpy takes ten times as long for them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.frames import Array

Vector = tuple[float, float, float]


def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def weighted(p: float, a: Vector, q: float, b: Vector, r: float, c: Vector) -> Vector:
    """Weighted sum of three."""
    return (
        p * a[0] + q * b[0] + r * c[0],
        p * a[1] + q * b[1] + r * c[1],
        p * a[2] + q * b[2] + r * c[2],
    )


def at_right_angles(a: Vector) -> Vector:
    """A unit vector at right angles to a unit vector."""
    x, y, z = a
    if abs(y) < 0.9:
        length = math.hypot(x, z)
        return (z / length, 0.0, -x / length)
    length = math.hypot(y, z)
    return (0.0, -z / length, y / length)


def vector(values: Array) -> Vector:
    """A tuple of an array (3,)."""
    x, y, z = values.tolist()
    return x, y, z


def rotation_vector(rotation: Array) -> Vector:
    """Axis times angle in radians of a (3, 3) rotation by less than half a turn."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = rotation.tolist()
    x, y, z = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-12:
        return (0.0, 0.0, 0.0)
    stretch = math.atan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0)) / sine
    return (x * stretch, y * stretch, z * stretch)


@dataclass(frozen=True, slots=True)
class Axes:
    """A rotation cam_from_pad by its first two columns.

    Attributes:
        forward: The pad's forward axis in the camera frame.
        right: Its right axis.
    """

    forward: Vector
    right: Vector

    @property
    def normal(self) -> Vector:
        """The pad's down axis in the camera frame."""
        return cross(self.forward, self.right)

    @property
    def rotation(self) -> Array:
        """(3, 3)."""
        (fx, fy, fz), (rx, ry, rz), (nx, ny, nz) = self.forward, self.right, self.normal
        return np.array([[fx, rx, nx], [fy, ry, ny], [fz, rz, nz]])

    def turned(self, w: Vector) -> Axes:
        """Turned by |w| radians about w (camera axes), by Rodrigues' formula."""
        angle = math.sqrt(dot(w, w))
        if angle < 1e-12:
            return self
        k = (w[0] / angle, w[1] / angle, w[2] / angle)
        c, s = math.cos(angle), math.sin(angle)
        f, r = self.forward, self.right
        return Axes(
            weighted(c, f, s, cross(k, f), (1.0 - c) * dot(k, f), k),
            weighted(c, r, s, cross(k, r), (1.0 - c) * dot(k, r), k),
        )
