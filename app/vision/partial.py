"""Landmarks that are cut by the image's border or partly covered: hypotheses from single sides.

A contour's straight run between two corners that turn the same way, with the beginnings of the two sides next to it,
may be a side of any of the drawing's contours of that colour and angle. Each such reading is a map of the pad's plane,
good enough for the edges to take over. Nothing is confirmed here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

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

Item = TypeVar("Item", bound=np.generic)

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


@dataclass(frozen=True, slots=True)
class Outline:
    """A contour and its corners, clockwise as seen, u to the right and v down.

    Attributes:
        points: (m, 2) of the contour, at distance 1 from the camera along its axis.
        index: (k,) which of them are its corners.
        px: (k, 2) these in the frame.
        border: (k,) whether they lie on the image's border.
        black: Whether the inside is black.
        reduction: Of the image that it was seen in.
    """

    points: Array
    index: NDArray[np.intp]
    px: Array
    border: NDArray[np.bool_]
    black: bool
    reduction: int

    @property
    def corners(self) -> Array:
        """(k, 2) at distance 1."""
        return self.points[self.index]


def _outline(points: NDArray[np.int32], black: bool, prepared: Prepared, view: View) -> Outline | None:
    """A contour's corners; None where there are less than three, or a part lies too far from the camera's axis."""
    thin = points[:: len(points) // MAX_POINTS + 1, 0]
    px = prepared.to_frame(thin.astype(np.float64))
    rays = view.lens.rays(px)
    middle = rays.sum(axis=0)
    if not math.isfinite(float(middle.sum())) or float(middle @ middle) < 1e-6 or float(rays[:, 2].min()) < WIDEST:
        return None
    flat = rays @ tangent_basis(middle).T
    if float(flat[:, 2].min()) < WIDEST:
        return None
    plane = (flat[:, :2] * (view.lens.focal_px / prepared.reduction / flat[:, 2:])).astype(np.float32)
    tolerance = max(TOLERANCE * cv2.arcLength(plane, True), TOLERANCE_MIN_PX)
    simple = np.asarray(cv2.approxPolyDP(plane.reshape(-1, 1, 2), tolerance, True), dtype=np.float32).reshape(-1, 2)
    if len(simple) < 3:
        return None
    index = _places(simple, plane)
    height, width = prepared.smooth.shape
    at = thin[index]
    border = (at < BORDER_PX).any(axis=1) | (at[:, 0] > width - 1 - BORDER_PX) | (at[:, 1] > height - 1 - BORDER_PX)
    ahead = rays[:, :2] / rays[:, 2:]
    x, y = ahead[index].T
    if float(x @ following(y) - following(x) @ y) < 0:
        ahead, index, border = ahead[::-1], len(ahead) - 1 - index[::-1], border[::-1]
        px = px[::-1]
    return Outline(ahead, index, px[index], border, black, prepared.reduction)


def _places(corners: NDArray[np.float32], points: NDArray[np.float32]) -> NDArray[np.intp]:
    """(k,) which of some points (m, 2) the corners (k, 2) are that approxPolyDP took from them, in their order. A
    contour that runs to and fro along a thin line passes a pixel twice.
    """
    same = _as_numbers(corners)[:, None] == _as_numbers(points)
    count, length = same.shape
    places = np.nonzero(same)[1]
    if len(places) == count:  # none is passed twice
        return places
    first = int(same.sum(axis=1).argmin())
    index = np.empty(count, dtype=np.intp)
    at = int(same[first].argmax())
    index[first] = at
    for k in range(first + 1, first + count):
        at = (at + 1 + int(np.roll(same[k % count], -at - 1).argmax())) % length
        index[k % count] = at
    return index


def _as_numbers(points: NDArray[np.float32]) -> NDArray[np.complex64]:
    """(n,) points (n, 2) as complex numbers: compared at once."""
    result: NDArray[np.complex64] = np.ascontiguousarray(points).view(np.complex64)[:, 0]
    return result


def _sides(outline: Outline) -> Iterator[Side]:
    """Sides of one closed polygon whose two corners turn the same way."""
    corners, px = outline.corners, outline.px
    n = len(corners)
    after = np.arange(1, n + 1) % n
    step = px[after] - px
    length_px: list[float] = np.sqrt((step * step).sum(axis=1)).tolist()
    if max(length_px) < SIDE_MIN_PX:
        return
    edge = corners[after] - corners
    length: list[float] = np.sqrt((edge * edge).sum(axis=1)).tolist()
    bend, angle_deg = turns_at(corners)
    angle: list[float] = angle_deg.tolist()
    inward: list[bool] = (bend > 0).tolist()
    cut: list[bool] = outline.border.tolist()
    black = outline.black
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


def following(row: NDArray[Item]) -> NDArray[Item]:
    """(n, ...) the next of each item of a closed row (n, ...); np.roll takes five times as long for a few."""
    return np.concatenate((row[1:], row[:1]))


def preceding(row: NDArray[Item]) -> NDArray[Item]:
    """(n, ...) the one before each item of a closed row (n, ...)."""
    return np.concatenate((row[-1:], row[:-1]))


def turns_at(corners: Array) -> tuple[Array, Array]:
    """(k,) of a polygon's corners (k, 2), clockwise: over 0 where it is convex; and the angle between the two sides."""
    edge = following(corners) - corners
    before = preceding(edge)
    bend = before[:, 0] * edge[:, 1] - before[:, 1] * edge[:, 0]
    return bend, 180.0 - np.degrees(np.abs(np.arctan2(bend, (before * edge).sum(axis=1))))


def outlines(tree: Tree, prepared: Prepared, view: View) -> list[Outline]:
    """The longest contours of a binary image with their corners."""
    long = np.flatnonzero(tree.length >= SHORTEST_PX)
    long = long[np.argsort(-tree.length[long], kind="stable")][:MAX_CONTOURS]
    found = [_outline(tree.points[k], bool(tree.black_inside[k]), prepared, view) for k in long.tolist()]
    return [outline for outline in found if outline is not None]


def sides(of: list[Outline]) -> list[Side]:
    """The longest sides of some contours, the longest first."""
    found = [side for outline in of for side in _sides(outline)]
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
