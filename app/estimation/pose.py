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
"""Standard deviation of a corner's coordinate: measured against rendered images (see the tests)."""
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
HOPELESS = 60.0
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
    angle = math.sqrt(float(v @ v))
    x, y, z = (float(c) for c in v)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-9:
        return np.asarray(np.eye(3) + k)
    return np.asarray(np.eye(3) + math.sin(angle) / angle * k + (1.0 - math.cos(angle)) / angle**2 * (k @ k))


def _cross_matrices(p: Array) -> Array:
    """(n, 3, 3) matrices [p]x of points (n, 3)."""
    out = np.zeros((len(p), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -p[:, 2], p[:, 1], -p[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = p[:, 2], -p[:, 1], p[:, 0]
    return out


def _residuals(problem: _Problem, rotation: Array, translation: Array) -> tuple[Array, Array] | None:
    """Residuals in sigmas and their derivatives with respect to (translation, rotation about the cam axes).

    None if a corner lies where the lens can't see.
    """
    turned = problem.pad @ rotation.T
    px, slope, valid = problem.lens.project_with_jacobian(turned + translation)
    if not valid.all():
        return None
    n = len(px)
    jacobian = np.empty((n, 2, 6))
    jacobian[:, :, :3] = slope
    jacobian[:, :, 3:] = -slope @ _cross_matrices(turned)
    r = (px - problem.px).reshape(-1) / CORNER_SIGMA_PX
    j = jacobian.reshape(-1, 6) / CORNER_SIGMA_PX
    if problem.down_cam is None:
        return r, j
    # The pad's down axis against the vertical: the cross product is their angle, for small ones, about each axis.
    axis = rotation[:, 2]
    tilt = np.cross(problem.down_cam, axis) / PRIOR_TILT_SIGMA_RAD
    d, a = problem.down_cam, axis
    # d(d x (w x a))/dw = (d . a) I - ... with w x a = -[a]x w.
    prior = np.zeros((3, 6))
    prior[:, 3:] = -(_cross_matrices(d[None])[0] @ _cross_matrices(a[None])[0]) / PRIOR_TILT_SIGMA_RAD
    return np.concatenate([r, tilt]), np.concatenate([j, prior])


def _weights(r: Array, corners: int) -> Array:
    """Huber's weights, by the length of each corner's residual; the prior's is 1."""
    length = np.sqrt(r[0 : 2 * corners : 2] ** 2 + r[1 : 2 * corners : 2] ** 2)
    weight = np.minimum(1.0, HUBER / np.maximum(length, 1e-12))
    return np.concatenate([np.repeat(weight, 2), np.ones(len(r) - 2 * corners)])


def _cost(r: Array, corners: int) -> float:
    """Huber's cost in squared sigmas."""
    length = np.sqrt(r[0 : 2 * corners : 2] ** 2 + r[1 : 2 * corners : 2] ** 2)
    robust = np.where(length <= HUBER, length * length, 2.0 * HUBER * length - HUBER * HUBER)
    return float(robust.sum() + (r[2 * corners :] ** 2).sum())


def _refine(problem: _Problem, rotation: Array, translation: Array) -> _Solution | None:
    """Damped Gauss-Newton from a start."""
    n = len(problem.pad)
    now = _residuals(problem, rotation, translation)
    if now is None:
        return None
    cost, damping = _cost(now[0], n), 1e-4
    for _ in range(STEPS):
        r, j = now
        weighted = j * _weights(r, n)[:, None]
        normal, slope = weighted.T @ j, weighted.T @ r
        try:
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
        except np.linalg.LinAlgError:
            return None
        tried_rotation = rotation_from_vector(np.asarray(step[3:])) @ rotation
        tried_translation = translation + step[:3]
        tried = _residuals(problem, tried_rotation, tried_translation)
        tried_cost = math.inf if tried is None else _cost(tried[0], n)
        if tried is None or tried_cost > cost:
            damping *= 10.0
            if damping > 1e6:
                break
            continue
        settled = cost - tried_cost < CONVERGED * max(cost, 1.0)
        rotation, translation, now, cost = tried_rotation, tried_translation, tried, tried_cost
        damping = max(damping * 0.1, 1e-9)
        if settled:
            break
    r, j = now
    information = (j * _weights(r, n)[:, None]).T @ j
    return _Solution(rotation, translation, cost, information, _rms_px(r, n))


def _rms_px(r: Array, corners: int) -> float:
    return CORNER_SIGMA_PX * math.sqrt(float(r[: 2 * corners] @ r[: 2 * corners]) / corners)


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
    scale = 0.5 * float(np.linalg.norm(pose[:, 0]) + np.linalg.norm(pose[:, 1]))
    pose = pose / scale
    u, _, vt = np.linalg.svd(np.column_stack([pose[:, 0], pose[:, 1], np.cross(pose[:, 0], pose[:, 1])]))
    rotation = u @ np.diag([1.0, 1.0, float(np.linalg.det(u @ vt))]) @ vt
    return rotation, np.asarray(pose[:, 2], dtype=np.float64)


def _other_start(rotation: Array, centre_cam: Array) -> Array:
    """The rotation whose normal is mirrored at the line of sight to the pattern: the second pose of a flat pattern."""
    sight = centre_cam / np.linalg.norm(centre_cam)
    normal = rotation[:, 2]
    mirrored = 2.0 * float(normal @ sight) * sight - normal
    axis = np.asarray(np.cross(normal, mirrored), dtype=np.float64)
    sine, cosine = float(np.linalg.norm(axis)), float(normal @ mirrored)
    if sine < 1e-9:
        return rotation
    return rotation_from_vector(axis / sine * math.atan2(sine, cosine)) @ rotation


def _level_start(rotation: Array, down_cam: Array) -> Array:
    """The rotation turned the shortest way so that the pad lies level."""
    axis = np.asarray(np.cross(rotation[:, 2], down_cam), dtype=np.float64)
    sine, cosine = float(np.linalg.norm(axis)), float(rotation[:, 2] @ down_cam)
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
    if down is not None:
        rotation = _level_start(rotation, down)
    first = _refine(problem, rotation, centre - rotation @ middle)
    base = rotation if first is None else first.rotation
    other = _other_start(base, centre)
    second: _Solution | None = None
    start_of_other = _residuals(problem, other, centre - other @ middle)
    if start_of_other is not None:
        n = len(pad)
        limit = math.inf if first is None else HOPELESS * max(first.cost, float(n))
        if _cost(start_of_other[0], n) < limit:
            second = _refine(problem, other, centre - other @ middle)
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
