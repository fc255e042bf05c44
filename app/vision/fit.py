"""Fits of the drawn landmark to corners and edges in the image, as a plane in front of the lens.

A fit is a (3, 3) matrix `rays_from_pad`: (forward, right, 1) in metres to a direction in the camera frame, up to scale.
It is proportional to [r1 r2 t] of the pose, so it holds for every lens: the lens turns directions into pixels. It is
estimated by the direct linear transform on a tangent plane (Hartley and Zisserman, "Multiple View Geometry", 4.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.camera_model import Lens, tangent_basis
from app.vision.geometry import LandmarkGeometry


def project_pad(rays_from_pad: Array, points: Array, lens: Lens) -> tuple[Array, NDArray[np.bool_]]:
    """Points (n, 2) of the pad's plane, forward and right in metres, to pixels (n, 2), and which are seen."""
    rays = points @ rays_from_pad[:, :2].T + rays_from_pad[:, 2]
    return lens.project(rays)


def homography(source: Array, target: Array) -> Array | None:
    """(3, 3) homography of points (n, 2) to points (n, 2), n >= 4, least squares; None if they determine none."""
    centre, scale = target.mean(axis=0), float(np.abs(target - target.mean(axis=0)).max())
    middle, size = source.mean(axis=0), float(np.abs(source - source.mean(axis=0)).max())
    if scale < 1e-12 or size < 1e-12:
        return None
    x, y = ((source - middle) / size).T
    u, v = ((target - centre) / scale).T
    n = len(x)
    rows = np.zeros((2 * n, 8))
    rows[:n, 0], rows[:n, 1], rows[:n, 2] = x, y, 1.0
    rows[n:, 3], rows[n:, 4], rows[n:, 5] = x, y, 1.0
    rows[:n, 6], rows[:n, 7] = -u * x, -u * y
    rows[n:, 6], rows[n:, 7] = -v * x, -v * y
    right = np.concatenate([u, v])
    try:
        h = np.linalg.solve(rows.T @ rows, rows.T @ right)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(h).all():
        return None
    core = np.append(h, 1.0).reshape(3, 3)
    back = np.array([[scale, 0.0, centre[0]], [0.0, scale, centre[1]], [0.0, 0.0, 1.0]])
    into = np.array([[1.0 / size, 0.0, -middle[0] / size], [0.0, 1.0 / size, -middle[1] / size], [0.0, 0.0, 1.0]])
    result: Array = back @ core @ into
    return result / result[2, 2] if abs(result[2, 2]) > 1e-9 else None


def affine(source: Array, target: Array) -> Array:
    """(3, 3) affine map that takes three points (3, 2) to three points (3, 2)."""
    rows = np.column_stack([source, np.ones(3)])
    result = np.eye(3)
    result[:2] = np.linalg.solve(rows, target).T
    return result


def apply(matrix: Array, points: Array) -> Array:
    """Homography of points (n, 2)."""
    q = points @ matrix[:, :2].T + matrix[:, 2]
    result: Array = q[:, :2] / q[:, 2:]
    return result


@dataclass(frozen=True, slots=True)
class Fit:
    """The landmark as it lies in one image.

    Attributes:
        rays_from_pad: (3, 3), see above.
        basis: (3, 3) tangent_from_cam of the plane it was made on.
        plane: (k, 2) the corners it rests on, on that plane, in the landmark's order.
        indices: (k,) which corners of the landmark those are.
        residual_px: Root mean square distance of these corners from the drawing, in pixels at the image centre.
    """

    rays_from_pad: Array
    basis: Array
    plane: Array
    indices: NDArray[np.intp]
    residual_px: float


def fit_corners(
    plane: Array, indices: NDArray[np.intp], basis: Array, geometry: LandmarkGeometry, focal_px: float
) -> Fit | None:
    """Fit to corners whose names are known; plane (k, 2) on the tangent plane `basis`, k >= 4."""
    matrix = homography(geometry.corners[indices], plane)
    if matrix is None:
        return None
    error = apply(matrix, geometry.corners[indices]) - plane
    residual = float(np.sqrt(np.mean(np.sum(error * error, axis=1)))) * focal_px
    return Fit(basis.T @ matrix, basis, plane, indices, residual)


def _best_turn(predicted: Array, found: Array) -> tuple[int, float]:
    """By how many corners `found` (k, 2) must be rolled to meet `predicted`, and the sum of squares that is left."""
    k = len(found)
    cost = [float(np.sum((np.roll(found, -turn, axis=0) - predicted) ** 2)) for turn in range(k)]
    turn = int(np.argmin(cost))
    return turn, cost[turn]


def fit_run(corners_px: list[Array], first: int, geometry: LandmarkGeometry, lens: Lens) -> list[Fit]:
    """All ways to lay the landmark on a run of polygons whose corners come in order, but from an unknown one on.

    Args:
        corners_px: For each contour of the run (k, 2), clockwise as seen.
        first: Index in the landmark of the outermost one.
        geometry: Of the landmark.
        lens: Of the camera.

    Returns:
        Fits, the best first, without those that are clearly worse than it. A run of squares alone gives up to four.
    """
    rays = lens.rays(np.concatenate(corners_px))
    basis = tangent_basis(rays.sum(axis=0))
    flat = rays @ basis.T
    plane = flat[:, :2] / flat[:, 2:]
    ends = np.cumsum([len(c) for c in corners_px])
    found = [plane[e - len(c) : e] for c, e in zip(corners_px, ends, strict=True)]
    drawn = [geometry.corners[geometry.slices[first + i]] for i in range(len(found))]
    indices = np.concatenate([np.arange(s.start, s.stop) for s in geometry.slices[first : first + len(found)]])
    anchor = next((i for i, c in enumerate(found) if len(c) == 4), 0)
    fits: list[Fit] = []
    for turn in range(len(found[anchor])):
        turned = np.roll(found[anchor], -turn, axis=0)
        guess = homography(drawn[anchor], turned) if len(turned) == 4 else affine(drawn[anchor], turned)
        if guess is None:
            continue
        ordered = [
            turned if i == anchor else np.roll(c, -_best_turn(apply(guess, drawn[i]), c)[0], axis=0)
            for i, c in enumerate(found)
        ]
        fit = fit_corners(np.concatenate(ordered), indices.astype(np.intp), basis, geometry, lens.focal_px)
        if fit is not None:
            fits.append(fit)
    fits.sort(key=lambda f: f.residual_px)
    return [f for f in fits if f.residual_px <= 1.5 * fits[0].residual_px + 0.3]
