"""Landmarks of which little more than a corner shows: hypotheses from the ring between two squares or two triangles.

Where a contour's corner and that of the next one in it are seen, with a piece of both sides at each, these four lines
cross in four points that are drawn too, and determine the map of the pad's plane. Nothing is confirmed here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.landmark import Shape
from app.vision.fit import homography
from app.vision.geometry import LandmarkGeometry
from app.vision.partial import Outline, following, preceding, turns_at
from app.vision.patch import View

ARM_MIN_PX = 8.0
"""Shortest piece of a side that counts."""
MERGED_PX = 6.0
CORNER_DEG = {Shape.SQUARE: (50.0, 130.0), Shape.TRIANGLE: (30.0, 95.0)}
SHARPEST_DEG, BLUNTEST_DEG = 30.0, 130.0
MAX_CORNERS = 60
MAX_RINGS = 4
MIN_WIDTH_PX = 3.0
"""Shortest way from corner to corner."""
ALONG, INWARD = 0.93, 0.8
"""Smallest cosines: between the sides of both contours, and of the way from corner to corner to the middle between the
outer one's sides."""
END_PART = 10
"""This part of a side, at each end, lies in a corner's blur."""
MAX_BENT = 0.45
"""How far the pad's two axes may be from right angles and equal lengths. Seen from above, a square's corner that is
read as a triangle's is 0.5 off."""
PARALLEL = 1e-6
CONCENTRIC = 1e-6


@dataclass(frozen=True, slots=True)
class _Corner:
    """A corner of something.

    Attributes:
        outline: Whose.
        number: Which of its corners.
        flipped: Whether the colour that the corner holds is not the one inside the contour.
    """

    outline: Outline
    number: int
    flipped: bool


@dataclass(frozen=True, slots=True)
class Ring:
    """A corner of a ring.

    Attributes:
        contour: Index of the outer one of the two contours.
        rays_from_pad: (3, 3), right but for a turn of that contour into itself.
        outline_px: (2, 2) the outer and the inner corner in the frame.
    """

    contour: int
    rays_from_pad: Array
    outline_px: Array


def rings(of: list[Outline], view: View) -> list[Ring]:
    """Hypotheses from some contours, those with the longest pieces of sides first."""
    geometry, contours = view.geometry, view.geometry.landmark.contours
    pairs = _alike(geometry)
    if not pairs or not of:
        return []
    corners, place, before, after, black, arm_px = _corners(of)
    found: list[Ring] = []
    for outer, inner in _pairs(place, before, after, black, arm_px, view.lens.focal_px):
        angle = 180.0 - math.degrees(math.acos(max(-1.0, min(1.0, float(before[outer] @ after[outer])))))
        kinds = [k for k in pairs if contours[k].black == black[outer] and _is_drawn(angle, contours[k].shape)]
        four = _crossings(_lines(corners[outer], view), _lines(corners[inner], view)) if kinds else None
        if four is None:
            continue
        for k in kinds:
            drawn = _drawn(geometry, k)
            matrix = homography(drawn, four)
            if matrix is not None and _is_possible(matrix, drawn):
                ends = [c.outline.px[c.number] for c in (corners[outer], corners[inner])]
                found.append(Ring(k, matrix, np.stack(ends)))
        if len(found) >= MAX_RINGS:
            break
    return found[:MAX_RINGS]


def _is_drawn(angle_deg: float, shape: Shape) -> bool:
    """Whether a corner of that angle may be one of a shape's."""
    low, high = CORNER_DEG[shape]
    return low < angle_deg < high


def _alike(geometry: LandmarkGeometry) -> list[int]:
    """Contours that are followed by one of the same shape, heading and middle."""
    found = []
    for k in range(len(geometry.landmark.contours) - 1):
        outer, inner = (geometry.corners[geometry.slices[j]] - geometry.centroids[j] for j in (k, k + 1))
        apart = geometry.centroids[k] - geometry.centroids[k + 1]
        if len(outer) == len(inner) and float(np.abs(apart).max()) < CONCENTRIC * geometry.size_m:
            size = float(np.linalg.norm(inner[0]) / np.linalg.norm(outer[0]))
            if float(np.abs(size * outer - inner).max()) < CONCENTRIC * geometry.size_m:
                found.append(k)
    return found


def _merged(outline: Outline) -> Outline:
    """A contour without the second of two corners that lie close together: a rounded one may be seen as two."""
    step = following(outline.px) - outline.px
    near = np.hypot(step[:, 0], step[:, 1]) < MERGED_PX * outline.reduction
    near &= ~outline.border & ~following(outline.border)
    kept = ~preceding(near)
    if kept.all() or np.count_nonzero(kept) < 3:
        return outline
    return replace(outline, index=outline.index[kept], px=outline.px[kept], border=outline.border[kept])


def _corners(of: list[Outline]) -> tuple[list[_Corner], Array, Array, Array, NDArray[np.bool_], Array]:
    """Corners of about the angles that are drawn, with the longest sides; (n, 2) where they are, at distance 1; (n, 2)
    directions of the sides before and after them, clockwise about the colour that the corner holds; (n,) whether that
    is black; (n,) the shorter side, pixels.
    """
    corners: list[_Corner] = []
    parts: list[tuple[Array, Array, Array, NDArray[np.bool_], Array]] = []
    for outline in map(_merged, of):
        at = outline.corners
        ahead = following(at) - at
        ahead = ahead / np.maximum(np.sqrt((ahead * ahead).sum(axis=1, keepdims=True)), 1e-12)
        step = following(outline.px) - outline.px
        long = np.sqrt((step * step).sum(axis=1))
        arm = np.minimum(long, preceding(long))
        bend, angle = turns_at(at)
        good = (arm >= ARM_MIN_PX) & (angle > SHARPEST_DEG) & (angle < BLUNTEST_DEG) & ~outline.border
        # Where the contour turns the other way, the corner holds the other colour; clockwise is the other way round.
        flipped = bend <= 0
        before, after = preceding(ahead), ahead
        first = np.where(flipped[:, None], -after, before)
        second = np.where(flipped[:, None], -before, after)
        corners += [_Corner(outline, int(k), bool(flipped[k])) for k in np.flatnonzero(good)]
        parts.append((at[good], first[good], second[good], (flipped ^ outline.black)[good], arm[good]))
    place, first, second, black, arm = (np.concatenate(column) for column in zip(*parts, strict=True))
    longest = np.argsort(-arm, kind="stable")[:MAX_CORNERS]
    kept = [corners[k] for k in longest.tolist()]
    return kept, place[longest], first[longest], second[longest], black[longest], arm[longest]


def _pairs(
    place: Array, before: Array, after: Array, black: NDArray[np.bool_], arm_px: Array, focal_px: float
) -> list[tuple[int, int]]:
    """Corners that may be those of a contour and of the next one in it, the longest sides first."""
    way = place[None] - place[:, None]
    length = np.sqrt((way * way).sum(axis=2))
    middle = after - before
    middle = middle / np.maximum(np.sqrt((middle * middle).sum(axis=1, keepdims=True)), 1e-12)
    fits = (black[:, None] != black) & (length * focal_px > MIN_WIDTH_PX)
    fits &= (before @ before.T > ALONG) & (after @ after.T > ALONG)
    fits &= np.einsum("ijx,ix->ij", way, middle) > INWARD * length
    outer, inner = np.nonzero(fits)
    # Where two would do for one, the nearer comes first.
    order = np.lexsort((length[outer, inner], -np.minimum(arm_px[outer], arm_px[inner])))
    return list(zip(outer[order].tolist(), inner[order].tolist(), strict=True))


def _lines(corner: _Corner, view: View) -> list[tuple[Array, Array]]:
    """The sides before and after a corner, each a point (2,) and a direction (2,) along the contour."""
    outline, count = corner.outline, len(corner.outline.index)
    half_px = (-0.5 if outline.black else 0.5) * outline.reduction / view.lens.focal_px
    found: list[tuple[Array, Array]] = []
    for first in (corner.number - 1, corner.number):
        start, stop = int(outline.index[first % count]), int(outline.index[(first + 1) % count])
        stop += len(outline.points) if stop <= start else 0
        off = (stop - start) // END_PART
        points = outline.points[np.arange(start + off, stop - off + 1) % len(outline.points)]
        middle = points.mean(axis=0)
        spread = points - middle
        _, axes = np.linalg.eigh(spread.T @ spread)
        along = axes[:, 1]
        # Contours run through the middles of black pixels: the edge lies half a pixel off, on the white side.
        inward = np.array([-along[1], along[0]])
        if along @ (outline.points[stop % len(outline.points)] - outline.points[start]) < 0:
            along, inward = -along, -inward
        found.append((middle + half_px * inward, along))
    return found[::-1] if corner.flipped else found


def _cross(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array | None:
    """(2,) where two lines cross."""
    (p, d), (q, e) = one, other
    area = float(e[0] * d[1] - d[0] * e[1])
    if abs(area) < PARALLEL:
        return None
    step = q - p
    result: Array = p + d * (float(e[0] * step[1] - e[1] * step[0]) / area)
    return result


def _crossings(outer: list[tuple[Array, Array]], inner: list[tuple[Array, Array]]) -> Array | None:
    """(4, 2) the outer corner, the outer side before with the inner one after, the inner corner, the inner side before
    with the outer one after.
    """
    points = [
        _cross(outer[0], outer[1]),
        _cross(outer[0], inner[1]),
        _cross(inner[0], inner[1]),
        _cross(inner[0], outer[1]),
    ]
    found = [p for p in points if p is not None]
    return np.stack(found) if len(found) == 4 else None


def _drawn(geometry: LandmarkGeometry, contour: int) -> Array:
    """(4, 2) the same points of the first corners of a contour and of the next one in it, metres."""

    def sides(k: int) -> list[tuple[Array, Array]]:
        corners = geometry.corners[geometry.slices[k]]
        return [(corners[0], corners[0] - corners[-1]), (corners[0], corners[1] - corners[0])]

    found = _crossings(sides(contour), sides(contour + 1))
    assert found is not None  # neighbouring sides of one polygon
    return found


def _is_possible(matrix: Array, drawn: Array) -> bool:
    """Whether a map has all four points (4, 2) before the camera, the print's face to it, and its two axes at about
    right angles and equally long.
    """
    if not ((drawn @ matrix[2, :2] + matrix[2, 2]) * matrix[2, 2] > 0.0).all() or float(np.linalg.det(matrix)) <= 0.0:
        return False
    (g00, g01, _), (_, g11, _), _ = (matrix.T @ matrix).tolist()
    unit = 0.5 * (g00 + g11)
    return unit > 0.0 and math.isfinite(unit) and max(abs(g01), 0.5 * abs(g00 - g11)) < MAX_BENT * unit
