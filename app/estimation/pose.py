"""Where the landmark is in the camera's frame: method `pnp`, and what both methods share.

All corners that were found are fitted through the lens model, robustly (Gauss-Newton with Levenberg's damping). A flat
pattern seen from afar has two poses; both are tried, and the vehicle's attitude with the assumption of a nearly level
pad decides between them and steadies the tilt. The covariance comes from the fit's own normal equations.
Sources: Hartley and Zisserman, "Multiple View Geometry", 4.1 and A6; Schweighofer and Pinz, "Robust pose estimation
from a planar target", 2006 (the two poses).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.frames import Array, Transform, quaternion_from_rotation, rotation_from_quaternion
from app.landmark import Landmark
from app.messages import CameraPose, Detection
from app.vision.camera_model import Lens, tangent_basis
from app.vision.fit import homography

CORNER_SIGMA_PX = 0.12
"""Standard deviation of a corner's coordinate. Chosen, not fitted: rendered images show 0.02 to 0.1 px, and real ones
will show more."""
COMMON_SIGMA_PX = 0.08
"""What all corners of a frame are off by together: blur, exposure and print make every black contour a little large or
small. It acts on the scale, and so on the distance."""
PRIOR_TILT_SIGMA_RAD = math.radians(6.0)
"""How far the pad's normal may be from the vertical that the vehicle's attitude gives: slopes, the car's springs, the
attitude's own error."""
HUBER = 2.5
"""Residuals above this many sigma count linearly."""
STEPS = 12
CONVERGED = 1e-3
"""Part of the cost, in squared sigmas, that a step must win to be followed by another."""
SAME_POSE = math.cos(math.radians(3.0))
"""Two starts nearer to each other than this lead to one pose."""
HOPELESS = 30.0
"""The second pose is not refined where it starts with this many times the first one's cost."""


@dataclass(frozen=True, slots=True)
class _Problem:
    """Corners and what they are compared with.

    Attributes:
        pad: (n, 3) corners in the pad frame.
        px: (n, 2) where they were seen.
        lens: The lens.
        down_cam: (3,) the vertical in the camera frame, or None.
    """

    pad: Array
    px: Array
    lens: Lens
    down_cam: Array | None


@dataclass(frozen=True, slots=True)
class _Solution:
    """One local optimum: rotation, translation, the robust cost and the information matrix (6, 6)."""

    rotation: Array
    translation: Array
    cost: float
    information: Array
    residual_px: float


def rotation_from_vector(v: Array) -> Array:
    """(3, 3) rotation by |v| radians about v (Rodrigues)."""
    x, y, z = (float(c) for c in v)
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = x / angle, y / angle, z / angle
    c, s = math.cos(angle), math.sin(angle)
    d = 1.0 - c
    return np.array(
        [
            [c + d * x * x, d * x * y - s * z, d * x * z + s * y],
            [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
            [d * x * z - s * y, d * y * z + s * x, c + d * z * z],
        ]
    )


_CROSS = np.zeros((3, 3, 3))
_CROSS[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = 1.0
_CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = -1.0
_CROSS_ROWS = _CROSS.reshape(3, 9)


def _cross_matrices(p: Array) -> Array:
    """(n, 3, 3) matrices [p]x of points (n, 3)."""
    return (p @ _CROSS_ROWS).reshape(-1, 3, 3)


@dataclass(frozen=True, slots=True)
class _Linear:
    """A pose with its residuals.

    Attributes:
        rotation: cam_from_pad.
        translation: The same.
        r: (2 n,) residuals of the corners in sigmas.
        j: (2 n, 6) their derivatives with respect to (translation, rotation about the cam axes).
        tilt: (3,) the prior's residuals, in sigmas; zeros without one.
        weight: (2 n,) Huber's.
        cost: Huber's, in squared sigmas, and the prior's.
    """

    rotation: Array
    translation: Array
    r: Array
    j: Array
    tilt: Array
    weight: Array
    cost: float


def _linearise(problem: _Problem, rotation: Array, translation: Array) -> _Linear | None:
    """Residuals and derivatives at a pose; None if a corner lies where the lens can't see."""
    turned = problem.pad @ rotation.T
    px, slope, valid = problem.lens.project_with_jacobian(turned + translation)
    if not valid.all():
        return None
    jacobian = np.empty((len(px), 2, 6))
    jacobian[:, :, :3] = slope
    np.matmul(slope, _cross_matrices(-turned), out=jacobian[:, :, 3:])
    off = (px - problem.px) / CORNER_SIGMA_PX
    length = np.sqrt((off * off).sum(axis=1))
    weight = HUBER / np.maximum(length, HUBER)
    # Huber's cost is L^2 up to k and 2 k L - k^2 beyond; with w = k / max(L, k) that is L^2 w (2 - w).
    cost = float((length * length * weight * (2.0 - weight)).sum())
    tilt = np.zeros(3)
    if problem.down_cam is not None:
        # The pad's down axis against the vertical: their cross product is the angle between them, about each axis.
        tilt = (_cross_matrices(problem.down_cam[None])[0] @ rotation[:, 2]) / PRIOR_TILT_SIGMA_RAD
        cost += float(tilt @ tilt)
    j = jacobian.reshape(-1, 6) / CORNER_SIGMA_PX
    return _Linear(rotation, translation, off.reshape(-1), j, tilt, np.repeat(weight, 2), cost)


def _normal(problem: _Problem, at: _Linear) -> tuple[Array, Array]:
    """Normal matrix (6, 6) and right side (6,) of a step."""
    weighted = at.j * at.weight[:, None]
    normal, slope = weighted.T @ at.j, weighted.T @ at.r
    if problem.down_cam is not None:
        both = _cross_matrices(np.stack([problem.down_cam, at.rotation[:, 2]]))
        # d(d x a) = d x (w x a) = -[d]x [a]x w.
        prior = (both[0] @ both[1]) / -PRIOR_TILT_SIGMA_RAD
        normal[3:, 3:] += prior.T @ prior
        slope[3:] += prior.T @ at.tilt
    return normal, slope


def _refine(problem: _Problem, start: _Linear) -> _Solution | None:
    """Damped Gauss-Newton from a start."""
    now, damping = start, 1e-6
    normal, slope = _normal(problem, now)
    for _ in range(STEPS):
        damped = normal + np.diag(damping * np.diagonal(normal))
        try:
            step = np.asarray(np.linalg.solve(damped, -slope), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        if -float(slope @ step) < CONVERGED * max(now.cost, 1.0):
            break
        tried = _linearise(problem, rotation_from_vector(step[3:]) @ now.rotation, now.translation + step[:3])
        if tried is None or tried.cost > now.cost:
            damping = max(10.0 * damping, 1e-3)
            continue
        now, damping = tried, 0.1 * damping
        normal, slope = _normal(problem, now)
    rms = CORNER_SIGMA_PX * math.sqrt(float(now.r @ now.r) / len(problem.pad))
    return _Solution(now.rotation, now.translation, now.cost, normal, rms)


def _length(v: Array) -> float:
    return math.sqrt(float(v @ v))


def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,); numpy's own takes ten times as long."""
    ax, ay, az = (float(c) for c in a)
    bx, by, bz = (float(c) for c in b)
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _start(problem: _Problem) -> tuple[Array, Array] | None:
    """A first pose from the homography of the pad's plane to a plane tangent to the view."""
    rays = problem.lens.rays(problem.px)
    if not np.isfinite(rays).all():
        return None
    basis = tangent_basis(rays.sum(axis=0))
    flat = rays @ basis.T
    if flat[:, 2].min() < 0.05:
        return None
    matrix = homography(problem.pad[:, :2], flat[:, :2] / flat[:, 2:])
    if matrix is None:
        return None
    pose = basis.T @ matrix
    forward, right = pose[:, 0], pose[:, 1]
    lengths = _length(forward), _length(right)
    if min(lengths) < 1e-12:
        return None
    # The two axes, turned towards or away from each other by the same angle until they stand at right angles.
    total, difference = forward / lengths[0] + right / lengths[1], forward / lengths[0] - right / lengths[1]
    if min(_length(total), _length(difference)) < 1e-9:
        return None
    total, difference = total / _length(total), difference / _length(difference)
    x, y = (total + difference) / math.sqrt(2.0), (total - difference) / math.sqrt(2.0)
    rotation = np.column_stack([x, y, _cross(x, y)])
    return rotation, pose[:, 2] * (2.0 / (lengths[0] + lengths[1]))


def _other_start(rotation: Array, centre_cam: Array) -> Array:
    """The rotation whose normal is mirrored at the line of sight to the pattern: the second pose of a flat pattern."""
    sight = centre_cam / _length(centre_cam)
    normal = rotation[:, 2]
    mirrored = 2.0 * float(normal @ sight) * sight - normal
    axis = _cross(normal, mirrored)
    sine, cosine = _length(axis), float(normal @ mirrored)
    if sine < 1e-9:
        return rotation
    return rotation_from_vector(axis / sine * math.atan2(sine, cosine)) @ rotation


def _level_start(rotation: Array, down_cam: Array) -> Array:
    """The rotation turned the shortest way so that the pad lies level."""
    axis = _cross(rotation[:, 2], down_cam)
    sine, cosine = _length(axis), float(rotation[:, 2] @ down_cam)
    if sine < 1e-9:
        return rotation
    return rotation_from_vector(axis / sine * math.atan2(sine, cosine)) @ rotation


def estimate_camera_pose(
    detection: Detection, landmark: Landmark, lens: Lens, prior_rotation_cam_from_pad: Array | None = None
) -> CameraPose | None:
    """Method `pnp`: fit every corner of a detection through the lens.

    Args:
        detection: With at least one contour.
        landmark: Whose corners they are.
        lens: Of the camera.
        prior_rotation_cam_from_pad: (3, 3) of a level pad at the vehicle's attitude, any heading; only its down axis is
            used. None: without, the pose that fits better is taken.

    Returns:
        The pose; None where the corners don't determine one.
    """
    if not detection.contours:
        return None
    pad = np.concatenate([landmark.contours[c.index].corners_m for c in detection.contours])
    px = np.concatenate([c.corners_px for c in detection.contours])
    down = None if prior_rotation_cam_from_pad is None else np.asarray(prior_rotation_cam_from_pad)[:, 2]
    problem = _Problem(np.column_stack([pad, np.zeros(len(pad))]), px, lens, down)
    start = _start(problem)
    if start is None:
        return None
    rotation, translation = start
    middle = problem.pad.mean(axis=0)
    centre = rotation @ middle + translation

    def solve(rotation: Array, hopeless: float) -> _Solution | None:
        """From a rotation about the middle of what was seen, unless it starts too badly."""
        at = _linearise(problem, rotation, centre - rotation @ middle)
        return None if at is None or at.cost > hopeless else _refine(problem, at)

    first = solve(rotation if down is None else _level_start(rotation, down), math.inf)
    base = rotation if first is None else first.rotation
    other = _other_start(base, centre)
    second: _Solution | None = None
    # Begun at the vertical and agreeing with the corners and with the vertical: nothing is left to be decided.
    settled = down is not None and first is not None and first.cost < len(pad)
    if not settled and (first is None or float(other[:, 2] @ base[:, 2]) < SAME_POSE):
        second = solve(other, math.inf if first is None else HOPELESS * max(first.cost, float(len(pad))))
    solutions = [s for s in (first, second) if s is not None and float(s.rotation[:, 2] @ s.translation) > 0]
    if not solutions:
        return None
    best = min(solutions, key=lambda s: s.cost)
    return _camera_pose(best, problem)


def _camera_pose(best: _Solution, problem: _Problem) -> CameraPose | None:
    """The solution with an honest covariance.

    What the normal equations give is widened where the residuals are larger than expected, and by an error that all
    contours share: it changes the pattern's size in the image, and so moves the pad along the line of sight.
    """
    try:
        covariance = np.linalg.inv(best.information)
    except np.linalg.LinAlgError:
        return None
    free = max(1, 2 * len(problem.pad) - 6)
    unit = best.residual_px**2 * len(problem.pad) / free / CORNER_SIGMA_PX**2
    covariance = covariance * max(1.0, unit)
    spread = problem.px - problem.px.mean(axis=0)
    radius_px = max(float(np.sqrt((spread * spread).sum(axis=1).mean())), 1.0)
    along = np.zeros(6)
    along[:3] = best.translation * (COMMON_SIGMA_PX / radius_px)
    covariance = covariance + np.outer(along, along)
    return CameraPose(
        best.translation, quaternion_from_rotation(best.rotation), 0.5 * (covariance + covariance.T), best.residual_px
    )


def cam_from_pad(pose: CameraPose) -> Transform:
    """A camera pose as a transform."""
    return Transform(rotation_from_quaternion(pose.q_cam_from_pad_wxyz), pose.t_cam_from_pad_m)


def predicted_corners_px(pose: CameraPose, landmark: Landmark, lens: Lens, index: int = 0) -> Array:
    """(n, 2) corners of a contour where the pose puts them, seen or not; not a number outside the lens's view."""
    corners = landmark.contours[index].corners_m
    points = cam_from_pad(pose).apply(np.column_stack([corners, np.zeros(len(corners))]))
    return lens.project(points)[0]
