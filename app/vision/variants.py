"""The landmark drawn, and what it must not be taken for: with a contour upside down, missing, of another size, shape or
place, or with all inside turned. What the camera makes of a drawing is template's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.landmark import Contour, Landmark, Shape
from app.vision.template import PATCH, PATCH_EXTENT

INSIDE_TURNED_RAD = math.radians(20.0)
"""A rival has all inside the second contour turned by so much."""
FINE = 4
"""Points along a cell when the drawing is made."""


@dataclass(frozen=True, slots=True)
class Variants:
    """The landmark first, then what it must not be taken for.

    Attributes:
        names: What is changed, for people.
        contour: The outermost one that differs.
        reshaped: Whether the innermost contour has another shape, and all else is as drawn.
        white: (n, m, m) with FINE x FINE points a cell: 1 where white is printed.
        outside: (m, m) 1 outside the quiet zone.
    """

    names: list[str]
    contour: list[int]
    reshaped: list[bool]
    white: NDArray[np.float32]
    outside: NDArray[np.float32]


def variants_of(landmark: Landmark) -> Variants:
    """Draw a landmark and its variants."""
    own = [(c.corners_m, c.black) for c in landmark.contours]
    found = [("as drawn", 0, False, _drawn(landmark, own))]
    for k, contour in enumerate(landmark.contours):
        changes: list[tuple[str, Array]] = []
        if k > 0:
            found.append((f"without {contour.name}", k, False, _drawn(landmark, own[:k])))
        if contour.shape is Shape.TRIANGLE:
            changes.append(("upside down", 2.0 * contour.centroid_m - contour.corners_m))
        if contour.shape is Shape.TRIANGLE or (k == 0 and len(own) > 1):
            changes.append(("a disc", contour.centroid_m + _regular(24, contour.area_m2, 0.0)))
        for word, factor in (("larger", 1.3), ("smaller", 0.7)) if k > 0 else ():
            changes.append((word, contour.centroid_m + factor * (contour.corners_m - contour.centroid_m)))
        innermost = contour is landmark.contours[-1]
        shapes = _other_shapes(contour) if innermost else []
        changes += [*shapes, *(_other_places(contour) if innermost else ())]
        for name, corners in changes:
            changed = [*own[:k], (corners, contour.black), *own[k + 1 :]]
            shaped = any(name == shape for shape, _ in shapes)
            found.append((f"with {contour.name} {name}", k, shaped, _drawn(landmark, changed)))
    if len(own) > 2:
        for name, sign in (("clockwise", 1.0), ("counterclockwise", -1.0)):
            c, s = math.cos(sign * INSIDE_TURNED_RAD), math.sin(sign * INSIDE_TURNED_RAD)
            centre, turn = landmark.contours[2].centroid_m, np.array([[c, s], [-s, c]])
            inside = [(centre + (corners - centre) @ turn, black) for corners, black in own[2:]]
            text = f"with {landmark.contours[2].name} turned {name}"
            found.append((text, 2, False, _drawn(landmark, own[:2] + inside)))
    names, outermost, reshaped, white = zip(*found, strict=True)
    return Variants(list(names), list(outermost), list(reshaped), np.stack(white), _outside(landmark))


def _points(landmark: Landmark) -> Array:
    """(n * n, 2) forward and right, metres: FINE x FINE points a cell of the patch."""
    n = FINE * PATCH
    half = 0.5 * PATCH_EXTENT * landmark.size_m
    at = half * (1.0 - (2.0 * np.arange(n) + 1.0) / n)
    forward, right = np.meshgrid(at, -at, indexing="ij")
    return np.column_stack([forward.ravel(), right.ravel()])


def _outside(landmark: Landmark) -> NDArray[np.float32]:
    """(m, m), see Variants."""
    found = np.abs(_points(landmark)).max(axis=1) > 0.5 * landmark.quiet_zone_m
    return np.asarray(found.reshape(FINE * PATCH, -1), dtype=np.float32)


def _drawn(landmark: Landmark, contours: Sequence[tuple[Array, bool]]) -> NDArray[np.float32]:
    """(n, n) with FINE x FINE points a cell: 1 where white is printed.

    Args:
        landmark: Of whose quiet zone.
        contours: Corners (k, 2) and whether the inside is black, outermost first.
    """
    points = _points(landmark)
    white = np.abs(points).max(axis=1) <= 0.5 * landmark.quiet_zone_m
    for corners, black in contours:
        white = np.where(gaps_to_points(corners, points) > 0, not black, white)
    return np.asarray(white.reshape(FINE * PATCH, -1), dtype=np.float32)


def _regular(count: int, area_m2: float, first_deg: float) -> Array:
    """(count, 2) corners of a regular polygon about 0, clockwise."""
    radius = math.sqrt(area_m2 / (0.5 * count * math.sin(2.0 * math.pi / count)))
    angle = math.radians(first_deg) + 2.0 * math.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _other_shapes(contour: Contour) -> list[tuple[str, Array]]:
    """What a contour may be replaced by: other polygons, as large as it or larger, clockwise."""
    found: list[tuple[str, Array]] = []
    kinds = [("a disc", 24, 0.0), ("a diamond", 4, 0.0), ("a square", 4, 45.0)]
    kinds += [("a triangle", 3, 0.0), ("a triangle, inverted", 3, 180.0)]
    for name, count, first_deg in kinds:
        if name == f"a {contour.shape.value}":
            continue
        arm = _regular(count, contour.area_m2, first_deg)
        found += [(name, contour.centroid_m + arm), (f"{name}, larger,", contour.centroid_m + 1.25 * arm)]
    return found


def _other_places(contour: Contour) -> list[tuple[str, Array]]:
    """Where a contour may be moved to, by half of its side."""
    step = 0.5 * contour.side_m
    ways = {"forward": (step, 0.0), "back": (-step, 0.0), "right": (0.0, step), "left": (0.0, -step)}
    return [(f"moved {name}", contour.corners_m + np.array(way)) for name, way in ways.items()]


def gaps_to_points(corners: Array, points: Array) -> Array:
    """(n,) depth of points (n, 2) inside a clockwise convex polygon (k, 2), in its unit; negative outside."""
    edge = np.roll(corners, -1, axis=0) - corners
    normal = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
    result: Array = (points @ normal.T - np.sum(normal * corners, axis=1)).min(axis=1)
    return result
