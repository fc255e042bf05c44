"""Coordinate frames, rotations and rigid transforms. The only file in which axes are permuted.

Frames: `ned` (north, east, down; origin of PX4's estimator), `body` (forward, right, down), `cam` (OpenCV: right in
the image, down in the image, into the scene), `pad` (forward, right, down; origin at the centre of the outer
contour). A rotation or transform is named `a_from_b`: it takes coordinates in b and returns them in a, so neighbours
cancel by eye: `ned_from_pad = ned_from_body @ body_from_cam @ cam_from_pad`.
Quaternions are Hamilton, unit, ordered w, x, y, z.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NORM_MIN = 1e-9
"""A quaternion this short has no direction."""

BODY_FROM_CAM_DOWN: Array = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation of a camera that looks straight down with the top of its image to the front: image right is body right,
image down is body backward, into the scene is body down."""


def wrap_angle_rad(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def rotation_from_yaw(yaw_rad: float) -> Array:
    """(3, 3) rotation about the down axis: ned_from_body of a level vehicle that heads yaw_rad clockwise of north."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """(3, 3) ned_from_body of the aerospace angles: yaw about down, then pitch about right, then roll about forward."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    result: Array = rotation_from_yaw(yaw_rad) @ pitch @ roll
    return result


def yaw_from_rotation(rotation: Array) -> float:
    """Heading in radians, clockwise from north, of the forward axis of a (3, 3) ned_from_x."""
    return math.atan2(rotation[1, 0], rotation[0, 0])


def tilt_rad(rotation: Array) -> float:
    """Angle in radians, 0 to pi, between the third axis of a (3, 3) ned_from_x and down; NaN if an element is NaN.

    By the arc tangent: an arc cosine needs its argument clamped to -1..1, and min() and max() turn NaN into level.
    """
    return math.atan2(math.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])


def clamp(value: float, low: float, high: float) -> float:
    """The value, or the limit that it is beyond. NaN stays NaN: min() and max() would turn it into a limit."""
    return low if value < low else high if value > high else value


def is_rotation(q_wxyz: Array) -> bool:
    """Whether rotation_from_quaternion takes this quaternion (4,): it is finite and not zero."""
    return NORM_MIN < math.sqrt(float(q_wxyz @ q_wxyz)) < math.inf


def rotation_from_quaternion(q_wxyz: Array) -> Array:
    """(3, 3) rotation of a unit quaternion (4,); it is normalised first.

    Raises:
        ValueError: The quaternion is zero or not finite.
    """
    w, x, y, z = q_wxyz.tolist()
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not NORM_MIN < norm < math.inf:
        raise ValueError(f"not a rotation: quaternion {q_wxyz!r}")
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(rotation: Array) -> Array:
    """(4,) unit quaternion w, x, y, z with w >= 0 of a (3, 3) rotation (Shepperd's method)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    trace = xx + yy + zz
    largest = max(trace, xx, yy, zz)
    if largest == trace:
        w, x, y, z = 1 + trace, zy - yz, xz - zx, yx - xy
    elif largest == xx:
        w, x, y, z = zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx
    elif largest == yy:
        w, x, y, z = xz - zx, xy + yx, 1 + yy - xx - zz, yz + zy
    else:
        w, x, y, z = yx - xy, xz + zx, yz + zy, 1 + zz - xx - yy
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    norm = -norm if w < 0 else norm
    return np.array([w / norm, x / norm, y / norm, z / norm])


def slerp(q0_wxyz: Array, q1_wxyz: Array, fraction: float) -> Array:
    """(4,) quaternion between two unit quaternions along the shorter arc; fraction 0 gives q0, 1 gives q1."""
    dot = float(q0_wxyz @ q1_wxyz)
    if dot < 0.0:
        q1_wxyz, dot = -q1_wxyz, -dot
    if dot > 0.9995:
        q = q0_wxyz + fraction * (q1_wxyz - q0_wxyz)
    else:
        angle = math.acos(dot)
        q = (math.sin((1 - fraction) * angle) * q0_wxyz + math.sin(fraction * angle) * q1_wxyz) / math.sin(angle)
    result: Array = q / np.linalg.norm(q)
    return result


@dataclass(frozen=True, slots=True)
class Transform:
    """A rigid transform a_from_b: x_a = rotation @ x_b + translation.

    Attributes:
        rotation: (3, 3), a_from_b.
        translation: (3,) metres, the origin of b in a.
    """

    rotation: Array
    translation: Array

    def __matmul__(self, other: Transform) -> Transform:
        return Transform(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Transform:
        """b_from_a."""
        return Transform(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: Array) -> Array:
        """Points (n, 3) or (3,) of b, in a."""
        result: Array = points @ self.rotation.T + self.translation
        return result


def is_inside(point: tuple[float, float], corners: Sequence[tuple[float, float]]) -> bool:
    """Whether a point lies inside a polygon, both in any plane: the even-odd rule (a ray crosses the border an odd
    number of times). NaN is outside.
    """
    x, y = point
    inside = False
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            inside = not inside
    return inside
