"""The drawn pattern as polygons: what the printer prints, the renderer draws and the detector looks for.

The landmark is a nest of contours, black and white in turn, outermost black, on a white quiet zone. Each contour is a
regular polygon with one edge to the back (a square axis aligned, a triangle apex forward), sized by the ratio of its
area to the outermost's and placed inside its parent so that the gaps to the parent's sides are equal (in the least
squares sense, where they can't all be). For the paper's landmark this gives the table of the docs: squares concentric,
the first triangle with its bounding box centred, the second with the first's centroid, the innermost square with equal
gaps to the three sides.
Source: Wu et al., "Autonomous UAV Landing System Based on Visual Navigation", section II.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from app.errors import LandmarkError
from app.frames import Array

MIN_GAP_FRACTION = 0.01
"""Thinnest gap between neighbours, and shortest side, as a fraction of the side of the contour round it: 3.8 mm in a
square of 38 cm. A thinner line is lost to printing and to the camera at once. It is measured by the contour round it
and not by the outermost, since inner contours are looked at from near, where the outer ones are out of view."""


class Shape(StrEnum):
    """A contour's outline."""

    SQUARE = "square"
    TRIANGLE = "triangle"

    @property
    def corners(self) -> int:
        """How many corners it has."""
        return 4 if self is Shape.SQUARE else 3


@dataclass(frozen=True, slots=True)
class ContourSpec:
    """What a user writes for one contour.

    Attributes:
        shape: Its outline.
        area_ratio: Its area over the outermost's, 1 for the outermost itself.
        offset_forward_m: Moves it from where equal gaps place it.
        offset_right_m: The same to the right.
    """

    shape: Shape
    area_ratio: float
    offset_forward_m: float = 0.0
    offset_right_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Contour:
    """One contour in the pad frame.

    Attributes:
        name: "S1", "T3": its shape and its place counted from outside, from 1.
        shape: Its outline.
        black: Its inside (up to the next contour) is black.
        corners_m: (n, 2) forward, right. Squares: front-left, front-right, back-right, back-left. Triangles: front,
            back-right, back-left. Clockwise seen from above.
    """

    name: str
    shape: Shape
    black: bool
    corners_m: Array

    @property
    def area_m2(self) -> float:
        """Area by the shoelace formula."""
        x, y = self.corners_m.T
        return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))

    @property
    def side_m(self) -> float:
        """Length of a side."""
        return float(np.linalg.norm(self.corners_m[1] - self.corners_m[0]))

    @property
    def centroid_m(self) -> Array:
        """(2,) forward, right: centroid of the area (of the corners too, the polygons being regular)."""
        result: Array = self.corners_m.mean(axis=0)
        return result


@dataclass(frozen=True, slots=True)
class Landmark:
    """The whole pattern.

    Attributes:
        name: For people.
        contours: Outermost first.
        quiet_zone_m: Side of the white square about it.
    """

    name: str
    contours: tuple[Contour, ...]
    quiet_zone_m: float

    @property
    def code(self) -> str:
        """Corner counts, outermost first: "44334" for the paper's."""
        return "".join(str(contour.shape.corners) for contour in self.contours)

    @property
    def size_m(self) -> float:
        """Side of the outermost contour."""
        return self.contours[0].side_m

    def area_ratio(self, index: int) -> float:
        """Area of contour `index` over that of the next one inside it."""
        return self.contours[index].area_m2 / self.contours[index + 1].area_m2

    def gaps_m(self, index: int) -> Array:
        """(n,) distance of contour `index`, at least 1, from each side of the one round it."""
        return gaps_m(self.contours[index - 1].corners_m, self.contours[index].corners_m)


def _unit_polygon(shape: Shape) -> Array:
    """(n, 2) forward, right, of area 1, centred on its bounding box."""
    if shape is Shape.SQUARE:
        return np.array([[0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]])
    side = math.sqrt(4.0 / math.sqrt(3.0))
    height = side * math.sqrt(3.0) / 2.0
    return np.array([[height / 2, 0.0], [-height / 2, side / 2], [-height / 2, -side / 2]])


def gaps_m(parent: Array, child: Array) -> Array:
    """(n,) distance from each side of the parent (n, 2) to the nearest corner of the child; negative: outside."""
    edge = np.roll(parent, -1, axis=0) - parent
    length = np.hypot(edge[:, 0], edge[:, 1])
    # Clockwise seen from above, in (forward, right): the inward normal of an edge (f, r) is (-r, f).
    normal = np.column_stack([-edge[:, 1], edge[:, 0]]) / length[:, None]
    distance = normal @ child.T - np.sum(normal * parent, axis=1)[:, None]
    result: Array = distance.min(axis=1)
    return result


def _place(parent: Array, child: Array) -> Array:
    """Shift (2,) of the child that makes its gaps to the parent's sides equal, in the least squares sense."""
    edge = np.roll(parent, -1, axis=0) - parent
    normal = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
    matrix = np.column_stack([normal, -np.ones(len(parent))])
    solution, *_ = np.linalg.lstsq(matrix, -gaps_m(parent, child), rcond=None)
    return np.asarray(solution[:2], dtype=np.float64)


def _check_gap(name: str, label: str, spec: ContourSpec, parent: Contour, gap_m: float, limit_m: float) -> None:
    """Refuse a contour that comes too near to its parent's sides, touches them or sticks out.

    The shapes are convex and each lies in the one before, so neighbours are the only pairs that can meet.
    """
    if gap_m >= limit_m - 1e-12:
        return
    touch_m = 1e-9
    if gap_m < -touch_m:
        what = f"{label} crosses {parent.name}: it sticks out by {-gap_m * 1000:.2f} mm"
    elif gap_m <= touch_m:
        what = f"{label} touches {parent.name}"
    else:
        what = f"{label} in {parent.name} leaves a gap of {gap_m * 1000:.2f} mm"
    moved = spec.offset_forward_m != 0.0 or spec.offset_right_m != 0.0
    raise LandmarkError(
        f"landmark {name!r}: {what}",
        f"a gap of at least {limit_m * 1000:.2f} mm (1% of {parent.name}'s side) is needed: make {label} smaller "
        f"(its area_ratio is {spec.area_ratio:g})" + (" or move it less" if moved else ""),
    )


def build_landmark(
    name: str, size_m: float, specs: tuple[ContourSpec, ...], quiet_zone_m: float | None = None
) -> Landmark:
    """Draw a landmark from what a user wrote.

    Args:
        name: For people.
        size_m: Side of the outermost contour, which must be a square.
        specs: Outermost first; at least two.
        quiet_zone_m: Side of the white square about it; 46/38 of the size by default.

    Raises:
        LandmarkError: Shapes touch or cross, or a gap or a side is under the limit; it names the two and the limit.
    """
    if len(specs) < 2:
        raise LandmarkError(f"landmark {name!r} has {len(specs)} contour(s)", "give at least 2")
    if specs[0].shape is not Shape.SQUARE or abs(specs[0].area_ratio - 1.0) > 1e-9:
        raise LandmarkError(
            f"landmark {name!r}: the outermost contour is a {specs[0].shape} of area ratio {specs[0].area_ratio:g}",
            "make it a square with area_ratio = 1",
        )
    zone_m = size_m * 46.0 / 38.0 if quiet_zone_m is None else quiet_zone_m
    limit_m = MIN_GAP_FRACTION * size_m  # of the contour round the one that is looked at
    if zone_m - size_m < 2 * limit_m:
        raise LandmarkError(
            f"landmark {name!r}: the quiet zone of {zone_m * 100:.2f} cm leaves {(zone_m - size_m) * 50:.2f} cm round "
            f"S1 of {size_m * 100:.2f} cm",
            f"leave at least {limit_m * 100:.2f} cm on each side",
        )
    contours: list[Contour] = []
    for k, spec in enumerate(specs):
        label = f"{spec.shape.value[0].upper()}{k + 1}"
        if not 0.0 < spec.area_ratio <= 1.0:
            raise LandmarkError(
                f"landmark {name!r}: {label} has area_ratio {spec.area_ratio:g}", "give more than 0 and at most 1"
            )
        corners: Array = _unit_polygon(spec.shape) * math.sqrt(spec.area_ratio) * size_m
        if contours:
            parent = contours[-1]
            limit_m = MIN_GAP_FRACTION * parent.side_m
            corners = corners + _place(parent.corners_m, corners)
            corners = corners + np.array([spec.offset_forward_m, spec.offset_right_m], dtype=np.float64)
            _check_gap(name, label, spec, parent, float(gaps_m(parent.corners_m, corners).min()), limit_m)
        contours.append(Contour(label, spec.shape, k % 2 == 0, corners))
        if contours[-1].side_m < limit_m:
            raise LandmarkError(
                f"landmark {name!r}: {label} has sides of {contours[-1].side_m * 1000:.2f} mm",
                f"at least {limit_m * 1000:.2f} mm (1% of the side of the contour round it) is needed: "
                f"give it a larger area_ratio (it is {spec.area_ratio:g}) or leave it out",
            )
    return Landmark(name, tuple(contours), zone_m)


PAPER_CONTOURS: tuple[ContourSpec, ...] = (
    ContourSpec(Shape.SQUARE, 1.0),
    ContourSpec(Shape.SQUARE, 1 / 2),
    ContourSpec(Shape.TRIANGLE, 1 / 8),
    ContourSpec(Shape.TRIANGLE, 1 / 16),
    ContourSpec(Shape.SQUARE, 1 / 64),
)
"""The paper's nest, with its innermost square at half the paper's area: the paper's own ratio of 1/32 would touch all
three sides of the triangle round it."""


def paper_landmark(size_m: float = 0.38) -> Landmark:
    """The paper's landmark at a given outermost side."""
    return build_landmark("paper", size_m, PAPER_CONTOURS, size_m * 46.0 / 38.0)
