"""The landmark's plane before the lens, as a homography with a measure of how well it is known (messages.PlaneFit).

It owns the small warps d of that homography: how pixels move with them, how a fit moves by one, and the fit to corners
whose names are known. It does not find corners or edges, and it knows nothing of rotation and translation.
Source: Hartley and Zisserman, "Multiple View Geometry", 4.1 (the start), A6 (Gauss-Newton), A6.8 (Huber's weights).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.messages import PlaneFit
from app.vision.camera_model import Lens, tangent_basis

STEPS = 10
CONVERGED = 1e-6
"""Length of a step, in parts of `unit_m`, after which no other follows: 1e-4 px of a landmark of 100 px."""
NEAREST_TO_EDGE = 0.05
"""Least cosine between a corner's ray and the middle of all: beyond, no tangent plane shows the whole pattern."""


def warped(rays_from_pad: Array, d: Array, unit_m: float) -> Array:
    """(3, 3) rays_from_pad S W(d) S^-1, see PlaneFit.

    Args:
        rays_from_pad: (3, 3), (forward, right, 1) in metres to a direction in the camera frame.
        d: (8,) warp.
        unit_m: Length that d counts in.
    """
    d0, d1, d2, d3, d4, d5, d6, d7 = d.tolist()
    warp = np.array([[1.0 + d0, d1, d2 * unit_m], [d3, 1.0 + d4, d5 * unit_m], [d6 / unit_m, d7 / unit_m, 1.0]])
    result: Array = rays_from_pad @ warp
    return result


def warp_jacobian(
    rays_from_pad: Array, pad_m: Array, lens: Lens, unit_m: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Where points of the pad are seen, and how they move with the warp at d = 0.

    Args:
        rays_from_pad: (3, 3), see PlaneFit.
        pad_m: (n, 2) forward and right on the pad, metres.
        lens: Of the camera.
        unit_m: Length that d counts in.

    Returns:
        Pixels (n, 2); d pixel / d d (n, 2, 8); whether the lens can see each point (n,). What belongs to an invalid
        point is not to be used.
    """
    px, slope, valid = lens.project_with_jacobian(pad_m @ rays_from_pad[:, :2].T + rays_from_pad[:, 2])
    # ray = H S (q + (d0..d2 . q, d3..d5 . q, d6 q0 + d7 q1)) with q = (forward / unit, right / unit, 1).
    move = slope @ (rays_from_pad * np.array([unit_m, unit_m, 1.0]))
    q = np.ones((len(pad_m), 1, 3))
    q[:, 0, :2] = pad_m / unit_m
    jacobian = np.empty((len(pad_m), 2, 8))
    np.multiply(move[:, :, :1], q, out=jacobian[:, :, :3])
    np.multiply(move[:, :, 1:2], q, out=jacobian[:, :, 3:6])
    np.multiply(move[:, :, 2:], q[:, :, :2], out=jacobian[:, :, 6:])
    return px, jacobian, valid


def along_normals(jacobian: Array, normals_px: Array) -> Array:
    """(n, 8) how an edge point moves across its edge: jacobian (n, 2, 8) of warp_jacobian along unit normals (n, 2)."""
    result: Array = np.matmul(normals_px[:, None, :], jacobian)[:, 0]
    return result


def _direct(pad_m: Array, rays: Array) -> Array | None:
    """(3, 3) rays_from_pad by the direct linear transform on the plane tangent to the middle ray; None without one."""
    basis = tangent_basis(rays.sum(axis=0))
    flat = rays @ basis.T
    if flat[:, 2].min() < NEAREST_TO_EDGE:
        return None
    seen = flat[:, :2] / flat[:, 2:]
    middle, goal = pad_m.mean(axis=0), seen.mean(axis=0)
    size, scale = float(np.abs(pad_m - middle).max()), float(np.abs(seen - goal).max())
    if size < 1e-9 or scale < 1e-9:
        return None
    n = len(pad_m)
    source = np.column_stack([(pad_m - middle) / size, np.ones(n)])
    target = (seen - goal) / scale
    rows = np.zeros((2 * n, 9))
    rows[:n, :3] = rows[n:, 3:6] = source
    rows[:n, 6:] = -target[:, :1] * source
    rows[n:, 6:] = -target[:, 1:] * source
    values, vectors = np.linalg.eigh(rows.T @ rows)
    if values[1] < 1e-9 * values[-1]:
        return None  # more than one plane fits: corners in a line or on one point
    to_unit = np.array([[1.0 / size, 0.0, -middle[0] / size], [0.0, 1.0 / size, -middle[1] / size], [0.0, 0.0, 1.0]])
    from_unit = np.array([[scale, 0.0, goal[0]], [0.0, scale, goal[1]], [0.0, 0.0, 1.0]])
    matrix: Array = from_unit @ vectors[:, 0].reshape(3, 3) @ to_unit
    depth = pad_m @ matrix[2, :2] + matrix[2, 2]
    if float(depth.max()) < 0.0:
        matrix, depth = -matrix, -depth
    if float(depth.min()) <= 0.0:
        return None
    result: Array = basis.T @ matrix
    return result


def plane_fit_from_corners(
    pad_corners_m: Array,
    corners_px: Array,
    lens: Lens,
    sigma_px: float,
    unit_m: float,
    *,
    huber_sigmas: float = math.inf,
) -> PlaneFit | None:
    """The plane that leaves the least squares of pixels between drawn and found corners.

    Args:
        pad_corners_m: (n, 2) forward and right of the corners as drawn, metres; n >= 4.
        corners_px: (n, 2) where they were found.
        lens: Of the camera.
        sigma_px: Standard deviation of each coordinate of a corner; the information is J^T J / sigma_px^2.
        unit_m: Length that the warp counts in; half the landmark's side is a good one.
        huber_sigmas: Corners that are off by more than this many sigma_px pull with constant force; none by default.

    Returns:
        The fit; None where the corners determine no plane or the lens can't see it.
    """
    if len(pad_corners_m) < 4:
        return None
    rays = lens.rays(corners_px)
    if not np.isfinite(rays).all():
        return None
    matrix = _direct(pad_corners_m, rays)
    if matrix is None:
        return None
    limit_px = huber_sigmas * sigma_px
    step = 1.0
    for turn in range(STEPS + 1):
        px, jacobian, valid = warp_jacobian(matrix, pad_corners_m, lens, unit_m)
        if not valid.all():
            return None
        off = px - corners_px
        squares = np.einsum("ij,ij->i", off, off)
        weight = 1.0 if math.isinf(limit_px) else np.minimum(1.0, limit_px / np.sqrt(np.maximum(squares, 1e-300)))
        flat = jacobian.reshape(-1, 8)
        weighted = flat if isinstance(weight, float) else (jacobian * weight[:, None, None]).reshape(-1, 8)
        normal = weighted.T @ flat
        if step < CONVERGED or turn == STEPS:
            break
        try:
            d = np.linalg.solve(normal, -(weighted.T @ off.reshape(-1)))
        except np.linalg.LinAlgError:
            return None
        step = float(np.abs(d).max())
        if not step < 1.0:
            return None  # it runs away: no plane near the corners
        matrix = warped(matrix, d, unit_m)
    matrix = matrix / np.linalg.norm(matrix[:, 0])
    return PlaneFit(matrix, normal / sigma_px**2, unit_m, math.sqrt(float(squares.mean())))
