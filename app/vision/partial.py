"""Landmarks that are cut by the image's border or partly covered: hypotheses from single sides.

A contour's straight run between two corners that turn the same way, with the beginnings of the two sides next to it,
may be a side of any of the drawing's contours of that colour and angle. Each such reading is a map of the pad's plane,
good enough for the edges to take over. Nothing is confirmed here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.camera_model import tangent_basis
from app.vision.contours import Tree
from app.vision.fit import affine, homography
from app.vision.geometry import LandmarkGeometry
from app.vision.patch import View
from app.vision.preprocess import Prepared

SHORTEST_PX = 40
"""Contours with fewer pixels are left alone."""
MAX_CONTOURS = 14
MAX_POINTS = 400
TOLERANCE = 0.006
TOLERANCE_MIN_PX = 1.5
"""Of Douglas and Peucker's, as a part of the contour's length, and at least."""
SIDE_MIN_PX = 14.0
ARM_PART = 0.22
"""Shortest side next to it that counts, as a part of it."""
BORDER_PX = 2.5
WIDEST = 0.12
"""Smallest cosine to the camera's axis: 83 degrees."""
SQUARE_DEG = (62.0, 118.0)
TRIANGLE_DEG = (30.0, 88.0)
"""Mean of the two angles at a side: 90 and 60 where the camera looks straight down on the pad."""
SAME_LENGTH = (0.7, 1.45)
"""A next side that ends in a corner is taken as it is if its length is this part of the side's."""
MAX_SIDES = 8


@dataclass(frozen=True, slots=True)
class Side:
    """A side of something, with the beginnings of its neighbours, clockwise about the inside of its contour.

    Attributes:
        corners: (4, 2) end of the side before, the side's two corners, end of the side after; at distance 1 from the
            camera along its axis.
        whole: Whether the side before and the one after end in corners.
        black: Whether the inside is black.
        angle_deg: Mean of the angles at its two corners.
        length_px: Its length.
        outline_px: (4, 2) the same corners in the frame.
    """

    corners: Array
    whole: tuple[bool, bool]
    black: bool
    angle_deg: float
    length_px: float
    outline_px: Array


def _polygon(
    points: NDArray[np.int32], prepared: Prepared, view: View
) -> tuple[Array, Array, NDArray[np.bool_]] | None:
    """A contour's corners: at distance 1 (k, 2), in the frame (k, 2), and whether each lies on the border."""
    thin = points[:: len(points) // MAX_POINTS + 1, 0]
    px = prepared.to_frame(thin.astype(np.float64))
    rays = view.lens.rays(px)
    middle = rays.sum(axis=0)
    if not math.isfinite(float(middle.sum())) or float(middle @ middle) < 1e-6:
        return None
    flat = rays @ tangent_basis(middle).T
    if float(flat[:, 2].min()) < WIDEST:
        return None
    plane = (flat[:, :2] * (view.lens.focal_px / prepared.reduction / flat[:, 2:])).astype(np.float32)
    tolerance = max(TOLERANCE * cv2.arcLength(plane, True), TOLERANCE_MIN_PX)
    simple = np.asarray(cv2.approxPolyDP(plane.reshape(-1, 1, 2), tolerance, True), dtype=np.float32).reshape(-1, 2)
    if len(simple) < 3:
        return None
    # approxPolyDP returns points of its input: their places tell the rays.
    index = (_as_numbers(simple)[:, None] == _as_numbers(plane)).argmax(axis=1)
    corner_rays = rays[index]
    if float(corner_rays[:, 2].min()) < WIDEST:
        return None
    height, width = prepared.smooth.shape
    at = thin[index]
    border = (at < BORDER_PX).any(axis=1) | (at[:, 0] > width - 1 - BORDER_PX) | (at[:, 1] > height - 1 - BORDER_PX)
    return corner_rays[:, :2] / corner_rays[:, 2:], px[index], border


def _as_numbers(points: NDArray[np.float32]) -> NDArray[np.complex64]:
    """(n,) points (n, 2) as complex numbers: compared at once."""
    result: NDArray[np.complex64] = np.ascontiguousarray(points).view(np.complex64)[:, 0]
    return result


def _sides(corners: Array, px: Array, border: NDArray[np.bool_], black: bool) -> Iterator[Side]:
    """Sides of one closed polygon whose two corners turn the same way."""
    n = len(corners)
    after = np.arange(1, n + 1) % n
    x, y = corners[:, 0], corners[:, 1]
    if float(x @ y[after] - x[after] @ y) < 0:
        # Clockwise as seen, u to the right and v down.
        corners, px, border = corners[::-1], px[::-1], border[::-1]
    step = px[after] - px
    length_px: list[float] = np.sqrt((step * step).sum(axis=1)).tolist()
    if max(length_px) < SIDE_MIN_PX:
        return
    edge = corners[after] - corners
    length: list[float] = np.sqrt((edge * edge).sum(axis=1)).tolist()
    before = edge[after - 2]
    bend = before[:, 0] * edge[:, 1] - before[:, 1] * edge[:, 0]
    dot = (before * edge).sum(axis=1)
    angle: list[float] = (180.0 - np.degrees(np.abs(np.arctan2(bend, dot)))).tolist()
    inward: list[bool] = (bend > 0).tolist()
    cut: list[bool] = border.tolist()
    for p in range(n):
        q, end, begin = (p + 1) % n, (p + 2) % n, (p - 1) % n
        if cut[p] or cut[q] or inward[p] != inward[q] or length_px[p] < SIDE_MIN_PX:
            continue
        if min(length[begin], length[q]) < ARM_PART * length[p]:
            continue
        mean = 0.5 * (angle[p] + angle[q])
        whole = (not cut[begin] and inward[begin] == inward[p], not cut[end] and inward[end] == inward[p])
        order = [begin, p, q, end]
        if inward[p]:
            yield Side(corners[order], whole, black, mean, length_px[p], px[order])
        else:
            # The other colour lies inside, and clockwise about it is the other way round.
            yield Side(corners[order[::-1]], whole[::-1], not black, mean, length_px[p], px[order[::-1]])


def sides(tree: Tree, prepared: Prepared, view: View) -> list[Side]:
    """The longest sides of a binary image's contours, the longest first."""
    long = np.flatnonzero(tree.length >= SHORTEST_PX)
    long = long[np.argsort(-tree.length[long], kind="stable")][:MAX_CONTOURS]
    found: list[Side] = []
    for k in long.tolist():
        polygon = _polygon(tree.points[k], prepared, view)
        if polygon is not None:
            found += _sides(*polygon, bool(tree.black_inside[k]))
    found.sort(key=lambda s: -s.length_px)
    return found[:MAX_SIDES]


def _fitted(side: Side, drawn: Array) -> Array | None:
    """(3, 3) rays_from_pad that takes a polygon's corners (n, 2), clockwise from the side's first, to the side."""
    begin, p, q, end = side.corners
    along = q - p
    length = math.sqrt(float(along @ along))

    def arm(tip: Array, root: Array, whole: bool) -> Array:
        """A side next to it, as long as it is, or as found."""
        way = tip - root
        own = math.sqrt(float(way @ way))
        low, high = SAME_LENGTH
        result: Array = tip if whole and low * length <= own <= high * length else root + way * (length / own)
        return result

    if len(drawn) == 4:
        return homography(drawn, np.stack([p, q, arm(end, q, side.whole[1]), arm(begin, p, side.whole[0])]))
    # A triangle's third corner is where the two next sides meet.
    a, b = begin - p, end - q
    bend = a[0] * b[1] - a[1] * b[0]
    if abs(bend) < 1e-9:
        return None
    s = (along[0] * b[1] - along[1] * b[0]) / bend
    return affine(drawn, np.stack([p, q, p + s * a])) if s > 0.0 else None


def readings(side: Side, geometry: LandmarkGeometry) -> Iterator[tuple[int, Array]]:
    """Contours that the side may belong to, each with a map rays_from_pad (3, 3) that is right but for a turn of that
    contour into itself.
    """
    for k, contour in enumerate(geometry.landmark.contours):
        corners = contour.corners_m
        low, high = SQUARE_DEG if len(corners) == 4 else TRIANGLE_DEG
        if contour.black == side.black and low <= side.angle_deg <= high:
            matrix = _fitted(side, corners)
            if matrix is not None:
                yield k, matrix
