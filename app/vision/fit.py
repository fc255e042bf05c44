"""Fits of the drawn landmark to corners and edges in the image, as a plane in front of the lens.

A fit is a (3, 3) matrix `rays_from_pad`: (forward, right, 1) in metres to a direction in the camera frame, up to scale.
It is proportional to [r1 r2 t] of the pose, so it holds for every lens: the lens turns directions into pixels. It is
estimated by the direct linear transform on a tangent plane (Hartley and Zisserman, "Multiple View Geometry", 4.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.camera_model import Lens, tangent_basis
from app.vision.geometry import LandmarkGeometry

NEARLY_AS_GOOD = 0.01
"""Orders of the corners whose residuals differ by less than this part of the landmark's size are told apart by the
picture, not by the corners."""


def project_pad(rays_from_pad: Array, points: Array, lens: Lens) -> tuple[Array, NDArray[np.bool_]]:
    """Points (n, 2) of the pad's plane, forward and right in metres, to pixels (n, 2), and which are seen."""
    rays = points @ rays_from_pad[:, :2].T + rays_from_pad[:, 2]
    return lens.project(rays)


def homography(source: Array, target: Array) -> Array | None:
    """(3, 3) homography of points (n, 2) to points (n, 2), n >= 4, least squares; None if they determine none.

    Both are scaled but not shifted: the target's origin must be among or near its points.
    """
    size, scale = float(np.abs(source).max()), float(np.abs(target).max())
    if not (size > 1e-12 and scale > 1e-12 and math.isfinite(scale)):
        return None
    n = len(source)
    unit, goal = source / size, target / scale
    rows = np.zeros((2, n, 8))
    rows[0, :, :2] = rows[1, :, 3:5] = unit
    rows[0, :, 2] = rows[1, :, 5] = 1.0
    rows[0, :, 6:] = unit * -goal[:, :1]
    rows[1, :, 6:] = unit * -goal[:, 1:]
    flat = rows.reshape(2 * n, 8)
    try:
        h = np.linalg.solve(flat.T @ flat, flat.T @ goal.T.reshape(-1))
    except np.linalg.LinAlgError:
        return None
    shrink = scale / size
    result = np.array(
        [
            [h[0] * shrink, h[1] * shrink, h[2] * scale],
            [h[3] * shrink, h[4] * shrink, h[5] * scale],
            [h[6] / size, h[7] / size, 1.0],
        ]
    )
    return result if math.isfinite(float(result.sum())) else None


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
    drawn = geometry.corners[indices]
    matrix = homography(drawn, plane)
    if matrix is None:
        return None
    error = apply(matrix, drawn) - plane
    residual = math.sqrt(float(np.vdot(error, error)) / len(error)) * focal_px
    return Fit(basis.T @ matrix, basis, plane, indices, residual)


@dataclass(frozen=True, slots=True)
class _Order:
    """One way to name the corners of a run, with the sum of squares that it leaves (m^2, rectified).

    Attributes:
        cost: That sum.
        corners: (k,) which of the found corners is each of the drawn ones.
        turn: By how many parts of a circle the anchor was turned for it.
    """

    cost: float
    corners: NDArray[np.intp]
    turn: int


def _orders(rectified: list[Array], first: int, anchor: int, geometry: LandmarkGeometry) -> list[_Order]:
    """Names for the corners of a run, for each of the anchor's own symmetries.

    Args:
        rectified: (k, 2) corners of each contour on the pad, by a map that takes the anchor's to the drawn ones.
        first: Index in the landmark of the outermost one.
        anchor: Which of the run was mapped.
        geometry: Of the landmark.
    """
    centre = geometry.centroids[first + anchor]
    turns = geometry.turns(len(rectified[anchor]))
    cost = np.zeros(len(turns))
    names: list[NDArray[np.intp]] = []
    start = 0
    for i, corners in enumerate(rectified):
        k = len(corners)
        cycles = geometry.cycles(k)
        # What the map calls corner 0 may be any: turned[t] are the corners if it is corner t.
        turned = (corners - centre) @ turns + centre
        off = turned[:, cycles] - geometry.corners[geometry.slices[first + i]]
        squares = np.einsum("tckx,tckx->tc", off, off)
        best = squares.argmin(axis=1)
        cost += squares[np.arange(len(turns)), best]
        names.append(cycles[best] + start)
        start += k
    corners = np.concatenate(names, axis=1)
    return [_Order(float(cost[turn]), corners[turn], turn) for turn in range(len(turns))]


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
    anchor = next((i for i, c in enumerate(corners_px) if len(c) == 4), 0)
    before = sum(len(c) for c in corners_px[:anchor])
    mine = plane[before : before + len(corners_px[anchor])]
    drawn = geometry.corners[geometry.slices[first + anchor]]
    if len(mine) == 4:
        four = cv2.getPerspectiveTransform(mine.astype(np.float32), drawn.astype(np.float32))
        to_pad = np.asarray(four, dtype=np.float64)
    else:
        to_pad = affine(mine, drawn)
    on_pad = apply(to_pad, plane)
    rectified: list[Array] = []
    start = 0
    for corners in corners_px:
        rectified.append(on_pad[start : start + len(corners)])
        start += len(corners)
    orders = sorted(_orders(rectified, first, anchor, geometry), key=lambda o: o.cost)
    last = first + len(corners_px) - 1
    indices = np.arange(geometry.slices[first].start, geometry.slices[last].stop)
    worst = (1.5 * math.sqrt(orders[0].cost / start) + NEARLY_AS_GOOD * geometry.landmark.size_m) ** 2 * start
    best = fit_corners(plane[orders[0].corners], indices, basis, geometry, lens.focal_px)
    if best is None:
        return []
    fits = [best]
    centre = geometry.centroids[first + anchor]
    for order in orders[1:]:
        if order.cost > worst:
            break
        # The run looks the same when it is turned: so does its fit.
        turn = np.eye(3)
        turn[:2, :2] = geometry.turns(len(mine))[(order.turn - orders[0].turn) % len(mine)]
        turn[:2, 2] = centre - turn[:2, :2] @ centre
        turned = replace(best, rays_from_pad=best.rays_from_pad @ turn, plane=plane[order.corners])
        fits.append(turned)
    return fits
