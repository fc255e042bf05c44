"""Polygons from contours: Douglas-Peucker on a plane that is tangent to the view, where straight sides are straight
whatever the lens.

Source: Douglas and Peucker, "Algorithms for the reduction of the number of points required to represent a digitized
line or its caricature", 1973.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.camera_model import Lens, tangent_basis
from app.vision.preprocess import Prepared
from app.vision.refusal import Refusal, Rejection

MAX_POINTS = 160
"""Points of a contour that are used for its polygon."""
TOLERANCES = (0.035, 0.055, 0.08)
"""Douglas-Peucker tolerance over perimeter, tried in this order until three or four corners are left. A square's side
is a quarter of its perimeter; its corners survive up to 0.17."""
MIN_TOLERANCE_PX = 1.2
AREA_AGREEMENT = (0.78, 1.3)
"""A polygon's area over its contour's."""
WIDEST_RAY = 0.17
"""Smallest cosine between a contour's points and its middle: 80 degrees."""
ONE_PLANE = 0.6
"""Contours that all lie within 53 degrees of their common middle share one plane."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """A contour that Douglas-Peucker made a polygon of.

    Attributes:
        length_px: Pixels of its contour.
        corners_px: (k, 2) in the frame, clockwise as seen.
        corner_count: k if it is a convex triangle or quadrangle that explains its contour, else 0.
        rejection: Why it is none.
    """

    length_px: int
    corners_px: Array
    corner_count: int
    rejection: Rejection | None = None


def _simplified(plane: NDArray[np.float32]) -> tuple[NDArray[np.float32], Rejection | None]:
    """Corners (k, 2), clockwise, of a closed line (m, 2), and why they are no triangle or quadrangle."""
    perimeter = cv2.arcLength(plane, True)
    corners = plane
    for tolerance in TOLERANCES:
        simple = cv2.approxPolyDP(plane, max(tolerance * perimeter, MIN_TOLERANCE_PX), True)
        corners = np.asarray(simple, dtype=np.float32).reshape(-1, 2)
        if len(corners) <= 4:
            break
    covered = cv2.contourArea(corners, oriented=True)
    if covered < 0:
        corners = corners[::-1]
    count = len(corners)
    if count not in (3, 4):
        return corners, Rejection(Refusal.CORNERS, f"{count} corners, not 3 or 4")
    if not cv2.isContourConvex(np.ascontiguousarray(corners)):
        return corners, Rejection(Refusal.NOT_CONVEX, f"{count} corners, not convex")
    agreement = abs(covered) / max(cv2.contourArea(plane), 1e-9)
    low, high = AREA_AGREEMENT
    if not low <= agreement <= high:
        text = f"polygon covers {agreement:.2f} of its contour's area, outside {low}..{high}"
        return corners, Rejection(Refusal.CORNERS, text)
    return corners, None


def _outward(corners: Array, starts: list[int], by: Array) -> Array:
    """Corners (n, 2) of several polygons, moved so that each side moves outward by about `by` (exactly, if regular).

    Args:
        corners: Of one polygon after the other.
        starts: Where each begins.
        by: (polygons,) how far.
    """
    counts = np.diff([*starts, len(corners)])
    middle = np.add.reduceat(corners, starts) / counts[:, None]
    arm = corners - np.repeat(middle, counts, axis=0)
    length = np.sqrt((arm * arm).sum(axis=1)) + 1e-9
    reach = np.repeat(by / np.cos(math.pi / np.maximum(counts, 3)), counts)
    result: Array = corners + arm * (reach / length)[:, None]
    return result


def _planes(rays: Array, ends: list[int], focal_px: float) -> list[tuple[NDArray[np.float32], Array] | Rejection]:
    """For each contour its points on a tangent plane (m, 2), in pixels at the middle, and the plane's basis (3, 3)."""
    middle = rays.sum(axis=0)
    starts = [0, *ends[:-1]]
    if math.isfinite(float(middle.sum())):
        basis = tangent_basis(middle)
        flat = rays @ basis.T
        if float(flat[:, 2].min()) > ONE_PLANE:
            plane = (flat[:, :2] * (focal_px / flat[:, 2:])).astype(np.float32)
            return [(plane[a:b], basis) for a, b in zip(starts, ends, strict=True)]
    found: list[tuple[NDArray[np.float32], Array] | Rejection] = []
    for a, b in zip(starts, ends, strict=True):
        middle = rays[a:b].sum(axis=0)
        if not math.isfinite(float(middle.sum())):
            found.append(Rejection(Refusal.SHAPE, "a contour reaches out of the lens's view"))
            continue
        basis = tangent_basis(middle)
        flat = rays[a:b] @ basis.T
        if float(flat[:, 2].min()) < WIDEST_RAY:
            found.append(Rejection(Refusal.SHAPE, "a contour spans more than 160 degrees of view"))
            continue
        found.append(((flat[:, :2] * (focal_px / flat[:, 2:])).astype(np.float32), basis))
    return found


def polygons(
    outlines: Sequence[NDArray[np.int32]], black: Sequence[bool], prepared: Prepared, lens: Lens
) -> list[Polygon]:
    """The polygon of each contour; those that the border of the region cuts are refused.

    Args:
        outlines: (m, 1, 2) pixels of each contour in prepared.smooth.
        black: Whether the inside of each is black: a contour runs through the middles of black pixels, so its edge lies
            half a pixel outside of it, or inside.
        prepared: The region.
        lens: Of the camera.
    """
    height, width = prepared.smooth.shape
    result: list[Polygon | None] = [None] * len(outlines)
    inside: list[int] = []
    parts: list[NDArray[np.int32]] = []
    for k, points in enumerate(outlines):
        u, v, w, h = cv2.boundingRect(points)
        if u <= 0 or v <= 0 or u + w >= width or v + h >= height:
            box = np.array([[u, v], [u + w, v], [u + w, v + h], [u, v + h]], dtype=np.float64)
            text = f"contour of {len(points)} px is cut by the border of the image"
            result[k] = Polygon(len(points), prepared.to_frame(box), 0, Rejection(Refusal.CUT_BY_BORDER, text))
            continue
        inside.append(k)
        parts.append(points[:: len(points) // MAX_POINTS + 1, 0])
    if not inside:
        return [p for p in result if p is not None]
    px = prepared.to_frame(np.concatenate(parts).astype(np.float64))
    ends = np.cumsum([len(p) for p in parts]).tolist()
    shapes: list[tuple[int, NDArray[np.float32], Array, Rejection | None]] = []
    for k, end, part, on_plane in zip(inside, ends, parts, _planes(lens.rays(px), ends, lens.focal_px), strict=True):
        if isinstance(on_plane, Rejection):
            result[k] = Polygon(len(outlines[k]), px[end - len(part) : end], 0, on_plane)
            continue
        corners, refused = _simplified(on_plane[0])
        shapes.append((k, corners, on_plane[1], refused))
    if shapes:
        starts = np.cumsum([0, *(len(corners) for _, corners, _, _ in shapes[:-1])]).tolist()
        flat = np.concatenate([corners for _, corners, _, _ in shapes]).astype(np.float64)
        half = 0.5 * prepared.reduction
        flat = _outward(flat, starts, np.array([half if black[k] else -half for k, *_ in shapes]))
        flat = np.column_stack([flat / lens.focal_px, np.ones(len(flat))])
        places = [
            (start, start + len(corners), basis) for start, (_, corners, basis, _) in zip(starts, shapes, strict=True)
        ]
        corners_px, _ = lens.project(np.concatenate([flat[a:b] @ basis for a, b, basis in places]))
        for (k, corners, _, refused), start in zip(shapes, starts, strict=True):
            count = 0 if refused is not None else len(corners)
            result[k] = Polygon(len(outlines[k]), corners_px[start : start + len(corners)], count, refused)
    return [p for p in result if p is not None]
