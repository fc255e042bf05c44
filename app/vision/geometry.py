"""What the detector works out once from a landmark's drawing: corners, points along its sides, widths between contours,
and what is drawn, by itself and changed. Everything that depends on a pad's shapes and ratios is read here.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.landmark import Landmark, Shape, gaps_m
from app.vision.glance import Glance
from app.vision.template import PATCH, PATCH_EXTENT, Rivals, Template, seen_blurred
from app.vision.variants import Variants, gaps_to_points, variants_of

SAMPLES_PER_SIDE = 10
SLANTED = 0.1
"""Sine of the angle to either axis from which a side counts as slanted."""
SIDE_MARGIN = 0.09
"""Part of a side at each end that is not looked at: corners are rounded by blur."""
NODES = 9
"""Points along the patch that go through the lens; between them pixels are interpolated. For a landmark of 60 px that
is wrong by less than a hundredth of a pixel."""
JUDGED_EXTENT = 1.12
"""The middle part of the patch that is correlated, in sides of the outermost contour: what lies beyond may be
anything."""
BLURS_PER_OCTAVE = 4.0
RIVALS_KEPT = 6
"""Blurs whose rivals are kept, oldest out first: each is 3.5 to 8 MB, and a flight runs through twenty of them."""


@cache
def _cycles(corners: int) -> NDArray[np.intp]:
    count = np.arange(corners)
    return (count[:, None] + count) % corners


@cache
def _turns(corners: int) -> Array:
    angle = 2.0 * math.pi * np.arange(corners) / corners
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=1)


class LandmarkGeometry:
    """Arrays of one landmark. Sides and corners are listed contour by contour, outermost first.

    Attributes:
        landmark: The drawing.
        corners: (c, 2) all corners, metres.
        corner_contour: (c,) whose corner it is.
        slices: For each contour, its part of `corners` (and of the sides: a polygon has as many).
        following: (c,) index of the corner that the side of each corner leads to.
        previous: (c,) index of the side that ends at each corner; the side with the corner's own index starts there.
        side_points: (c, m, 2) points along each side, metres.
        side_normals: (c, 2) outward.
        side_sign: (c,) +1 where grey rises outward (a black contour), -1 where it falls.
        sides_m: (contours,) length of a side of each contour.
        size_m: The outermost's.
        area_ratios: (contours - 1,) area of each contour over that of the next one in it.
        gap_m: (c,) distance from each side to the nearest other edge of the drawing.
        patch_points: (PATCH * PATCH, 2) centres of the cells of the rectified patch, front row first, left to right.
        patch_nodes: (NODES * NODES, 2) points spread evenly over them, from the first cell's centre to the last's.
        between_nodes: (PATCH, NODES) weights that interpolate linearly from nodes to cells, along either axis.
        point_slanted: (points,) whether a point lies on a side along neither axis: squares in squares have none.
    """

    def __init__(self, landmark: Landmark) -> None:
        self.landmark = landmark
        contours = landmark.contours
        self.corners: Array = np.concatenate([c.corners_m for c in contours])
        counts = [len(c.corners_m) for c in contours]
        ends = np.cumsum(counts)
        self.slices = [slice(int(e) - n, int(e)) for n, e in zip(counts, ends, strict=True)]
        self.corner_contour: NDArray[np.intp] = np.repeat(np.arange(len(contours)), counts)
        self.previous: NDArray[np.intp] = np.concatenate(
            [np.roll(np.arange(s.start, s.stop), 1) for s in self.slices]
        ).astype(np.intp)
        self.following: NDArray[np.intp] = np.concatenate(
            [np.roll(np.arange(s.start, s.stop), -1) for s in self.slices]
        ).astype(np.intp)
        edge = self.corners[self.following] - self.corners
        length = np.hypot(edge[:, 0], edge[:, 1])
        # Corners run clockwise seen from above: the outward normal of an edge (forward, right) is (right, -forward).
        self.side_normals: Array = np.column_stack([edge[:, 1], -edge[:, 0]]) / length[:, None]
        at = np.linspace(SIDE_MARGIN, 1.0 - SIDE_MARGIN, SAMPLES_PER_SIDE)
        self.side_points: Array = self.corners[:, None] + edge[:, None] * at[:, None]
        self.side_sign: Array = np.array([1.0 if contours[k].black else -1.0 for k in self.corner_contour])
        self.gap_m: Array = self._gaps()
        half = 0.5 * PATCH_EXTENT * landmark.size_m
        cell = half * (1.0 - (2.0 * np.arange(PATCH) + 1.0) / PATCH)
        forward, right = np.meshgrid(cell, -cell, indexing="ij")
        self.patch_points: Array = np.column_stack([forward.ravel(), right.ravel()])
        at = np.linspace(cell[0], cell[-1], NODES)
        node_forward, node_right = np.meshgrid(at, -at, indexing="ij")
        self.patch_nodes: Array = np.column_stack([node_forward.ravel(), node_right.ravel()])
        place = np.linspace(0.0, NODES - 1.0, PATCH)
        self.between_nodes: Array = np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(NODES)))
        self.sides_m: Array = np.array([c.side_m for c in contours])
        self.size_m: float = landmark.size_m
        self.area_ratios: Array = np.array([landmark.area_ratio(k) for k in range(len(contours) - 1)])
        self.unit_m: float = 0.5 * landmark.size_m
        flat = self.side_points.reshape(-1, 2) / self.unit_m
        self.unit_points: Array = np.column_stack([flat, np.ones(len(flat))])
        self.unit_tangents: Array = np.repeat(edge / length[:, None], SAMPLES_PER_SIDE, axis=0)
        self.unit_gaps: Array = np.repeat(self.gap_m / self.unit_m, SAMPLES_PER_SIDE)
        self.point_sign: Array = np.repeat(self.side_sign, SAMPLES_PER_SIDE)
        self.point_contour: NDArray[np.intp] = np.repeat(self.corner_contour, SAMPLES_PER_SIDE)
        self.point_slanted: NDArray[np.bool_] = np.abs(self.unit_tangents).min(axis=1) > SLANTED
        self._templates: dict[int, Template] = {}
        self._rivals: dict[int, Rivals] = {}
        self._inners: dict[int, LandmarkGeometry] = {}
        self._cells: dict[int | None, NDArray[np.intp]] = {}
        self._insides: dict[int, NDArray[np.bool_]] = {}

    def point_slice(self, run: range) -> slice:
        """The points along the sides of neighbouring contours."""
        start, stop = self.slices[run.start].start, self.slices[run.stop - 1].stop
        return slice(start * SAMPLES_PER_SIDE, stop * SAMPLES_PER_SIDE)

    @cached_property
    def centroids(self) -> Array:
        """(contours, 2) forward, right, of each contour."""
        return np.stack([c.centroid_m for c in self.landmark.contours])

    def cycles(self, corners: int) -> NDArray[np.intp]:
        """(corners, corners) the ways to count a polygon's corners from each of them on."""
        return _cycles(corners)

    def turns(self, corners: int) -> Array:
        """(corners, 2, 2) matrices that turn row vectors (forward, right) by whole parts of a circle."""
        return _turns(corners)

    def turns_about(self, contour: int) -> list[Array]:
        """(3, 3) maps of the pad's plane that turn a contour into itself: (forward, right, 1) to the same."""
        centre = self.centroids[contour]
        found = []
        for turn in self.turns(len(self.landmark.contours[contour].corners_m)):
            matrix = np.eye(3)
            matrix[:2, :2] = turn.T
            matrix[:2, 2] = centre - turn.T @ centre
            found.append(matrix)
        return found

    @cached_property
    def outer_gap_m(self) -> Array:
        """(contours,) distance of each contour from the one round it (the quiet zone's edge for the outermost)."""
        zone = 0.5 * (self.landmark.quiet_zone_m - self.landmark.size_m)
        pairs = itertools.pairwise(self.landmark.contours)
        return np.array([zone, *(float(gaps_m(a.corners_m, b.corners_m).min()) for a, b in pairs)])

    def _gaps(self) -> Array:
        outer = self.outer_gap_m
        inner = np.append(outer[1:], 0.25 * self.landmark.contours[-1].side_m)
        return np.asarray(np.minimum(outer, inner)[self.corner_contour], dtype=np.float64)

    @cached_property
    def perimeter_ratios(self) -> tuple[float, ...]:
        """Length round each contour over that round the next one in it."""
        lengths = [c.side_m * c.shape.corners for c in self.landmark.contours]
        return tuple(a / b for a, b in itertools.pairwise(lengths))

    def inner_centre_m(self, first: int) -> Array:
        """(2,) forward, right: where `inner` has its origin, the middle of the contour's bounding box."""
        corners = self.landmark.contours[first].corners_m
        return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)), dtype=np.float64)

    def inner(self, first: int) -> LandmarkGeometry:
        """The drawing from a black contour on, with its origin in the middle of it, on the white that is round it."""
        if first not in self._inners:
            self._inners[first] = self._from(first)
        return self._inners[first]

    def _from(self, first: int) -> LandmarkGeometry:
        contours = self.landmark.contours
        white, centre = contours[first - 1], self.inner_centre_m(first)
        shifted = tuple(replace(c, corners_m=c.corners_m - centre) for c in contours[first:])
        room = contours[first].side_m + 2.0 * float(self.outer_gap_m[first])
        zone = min(room, white.side_m) if white.shape is Shape.TRIANGLE else white.side_m
        return LandmarkGeometry(Landmark(f"{self.landmark.name} from {contours[first].name}", shifted, zone))

    @cached_property
    def points_of(self) -> NDArray[np.intp]:
        """(contours,) how many points lie along the sides of each."""
        return np.bincount(self.point_contour)

    @cached_property
    def turns_visibly(self) -> NDArray[np.bool_]:
        """(contours,) whether a contour looks different when the landmark is turned by a quarter."""
        round_m = 1e-6 * self.size_m
        return np.array(
            [c.shape is not Shape.SQUARE or float(np.abs(c.centroid_m).max()) > round_m for c in self.landmark.contours]
        )

    @cached_property
    def square_part(self) -> float:
        """Area of the outermost contour over that of the judged cells."""
        cell_m = PATCH_EXTENT * self.size_m / PATCH
        return self.landmark.contours[0].area_m2 / (cell_m**2 * len(self.cells(None)))

    @cached_property
    def _variants(self) -> Variants:
        return variants_of(self.landmark)

    def template(self, sigma_cells: float) -> Template:
        """The drawing as seen with a blur (standard deviation) of that many cells, to the nearest of BLURS_PER_OCTAVE
        in an octave.
        """
        key = self._blur_key(sigma_cells)
        if key not in self._templates:
            sigma = self._sigma_cells(key)
            variants = self._variants
            white, outside = seen_blurred(np.stack([variants.white[0], variants.outside]), sigma)
            self._templates[key] = Template(white, outside, sigma)
        return self._templates[key]

    @staticmethod
    def _sigma_cells(key: int) -> float:
        return 0.25 * float(2.0 ** (key / BLURS_PER_OCTAVE))

    @staticmethod
    def _blur_key(sigma_cells: float) -> int:
        return max(0, round(BLURS_PER_OCTAVE * math.log2(max(sigma_cells, 0.25) / 0.25)))

    def rivals(self, sigma_cells: float) -> Rivals:
        """What the picture must not be taken for, at a blur of that many cells; the last RIVALS_KEPT are kept."""
        key = self._blur_key(sigma_cells)
        if key in self._rivals:
            self._rivals[key] = self._rivals.pop(key)
        else:
            own = self.template(sigma_cells)
            turns = self.landmark.contours[0].shape is Shape.SQUARE and bool(self.turns_visibly.any())
            variants = self._variants
            names = ["as drawn", *(f"turned by {90 * quarters} degrees" for quarters in (1, 2, 3))]
            rest = [False] * (len(variants.names) - 1)
            self._rivals[key] = Rivals(
                [*names, *variants.names[1:]],
                [False, turns, turns, turns, *rest],
                own,
                np.concatenate(
                    [
                        [np.rot90(own.white, quarters) for quarters in (1, 2, 3)],
                        seen_blurred(variants.white[1:], own.sigma_cells),
                    ]
                ),
                [0] * len(names) + variants.contour[1:],
                [False] * len(names) + variants.reshaped[1:],
            )
            if len(self._rivals) > RIVALS_KEPT:
                del self._rivals[next(iter(self._rivals))]
        return self._rivals[key]

    @cached_property
    def glance(self) -> Glance:
        """What small landmarks are told by at a first glance."""
        return Glance(self.landmark, JUDGED_EXTENT)

    @cached_property
    def judged(self) -> NDArray[np.bool_]:
        """(PATCH, PATCH) cells that lie on the landmark or close to it, inside the quiet zone."""
        half = 0.5 * min(JUDGED_EXTENT * self.landmark.size_m, self.landmark.quiet_zone_m)
        near = np.abs(self.patch_points).max(axis=1) < half
        return np.asarray(near, dtype=np.bool_).reshape(PATCH, PATCH)

    def cells(self, inside_of: int | None) -> NDArray[np.intp]:
        """Flat indices of the cells that are judged: all of them, or those inside a contour."""
        if inside_of not in self._cells:
            chosen = self.judged if inside_of is None else self.judged & self.inside(inside_of)
            self._cells[inside_of] = np.flatnonzero(chosen)
        return self._cells[inside_of]

    def inside(self, index: int) -> NDArray[np.bool_]:
        """(PATCH, PATCH) cells whose centre lies inside a contour."""
        if index not in self._insides:
            depth = gaps_to_points(self.landmark.contours[index].corners_m, self.patch_points)
            self._insides[index] = (depth > 0).reshape(PATCH, PATCH)
        return self._insides[index]
