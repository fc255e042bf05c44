"""What the detector works out once from a landmark's drawing: corners, points along its sides, widths between contours,
and the drawing as a picture to correlate with. Everything that depends on a pad's shapes and ratios is read here.
"""

from __future__ import annotations

import itertools
import math
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.landmark import Landmark, gaps_m

SAMPLES_PER_SIDE = 10
SIDE_MARGIN = 0.09
"""Part of a side at each end that is not looked at: corners are rounded by blur."""
PATCH = 32
"""Cells along the rectified patch."""
PATCH_EXTENT = 1.12
"""Its side, in sides of the outermost contour: some of the quiet zone shows."""


class LandmarkGeometry:
    """Arrays of one landmark. Sides and corners are listed contour by contour, outermost first.

    Attributes:
        landmark: The drawing.
        corners: (c, 2) all corners, metres.
        corner_contour: (c,) whose corner it is.
        slices: For each contour, its part of `corners` (and of the sides: a polygon has as many).
        previous: (c,) index of the side that ends at each corner; the side with the corner's own index starts there.
        side_points: (c, m, 2) points along each side, metres.
        side_normals: (c, 2) outward.
        side_sign: (c,) +1 where grey rises outward (a black contour), -1 where it falls.
        gap_m: (c,) distance from each side to the nearest other edge of the drawing.
        patch_points: (PATCH * PATCH, 2) centres of the cells of the rectified patch, front row first, left to right.
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
        following = np.concatenate([np.roll(np.arange(s.start, s.stop), -1) for s in self.slices])
        edge = self.corners[following] - self.corners
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
        self._templates: dict[int, Array] = {}
        self._insides: dict[int, NDArray[np.bool_]] = {}

    def _gaps(self) -> Array:
        contours = self.landmark.contours
        outer = [0.5 * (self.landmark.quiet_zone_m - self.landmark.size_m)]
        outer += [float(gaps_m(a.corners_m, b.corners_m).min()) for a, b in itertools.pairwise(contours)]
        inner = [*outer[1:], 0.25 * contours[-1].side_m]
        per_contour = np.minimum(outer, inner)
        return np.asarray(per_contour[self.corner_contour], dtype=np.float64)

    def perimeter_m(self, index: int) -> float:
        """Length round a contour."""
        contour = self.landmark.contours[index]
        return contour.side_m * contour.shape.corners

    @cached_property
    def _drawing(self) -> NDArray[np.float32]:
        """The patch at 8 x 8 points a cell, 0 black and 1 white."""
        fine = 8 * PATCH
        scale = fine / (PATCH_EXTENT * self.landmark.size_m)
        image = np.ones((fine, fine), dtype=np.float32)
        for contour in self.landmark.contours:
            u = fine / 2 + contour.corners_m[:, 1] * scale - 0.5
            v = fine / 2 - contour.corners_m[:, 0] * scale - 0.5
            points = np.rint(np.column_stack([u, v]) * 16).astype(np.int32)
            cv2.fillConvexPoly(image, points, 0.0 if contour.black else 1.0, lineType=cv2.LINE_8, shift=4)
        return image

    def template(self, sigma_cells: float) -> Array:
        """(PATCH, PATCH) the drawing as seen with a blur of that many cells, 0 black to 1 white."""
        key = max(0, round(8.0 * math.log2(max(sigma_cells, 0.25) / 0.25)))
        if key not in self._templates:
            sigma = 0.25 * 2.0 ** (key / 8.0)
            blurred = cv2.GaussianBlur(self._drawing, (0, 0), sigma * 8.0, borderType=cv2.BORDER_REPLICATE)
            cells = blurred.reshape(PATCH, 8, PATCH, 8).mean(axis=(1, 3))
            self._templates[key] = cells.astype(np.float64)
        return self._templates[key]

    def inside(self, index: int) -> NDArray[np.bool_]:
        """(PATCH, PATCH) cells whose centre lies inside a contour."""
        if index not in self._insides:
            depth = gaps_to_points(self.landmark.contours[index].corners_m, self.patch_points)
            self._insides[index] = (depth > 0).reshape(PATCH, PATCH)
        return self._insides[index]

    @cached_property
    def fold(self) -> int:
        """By how many quarter turns the drawing looks different: 4, 2 or, for concentric squares alone, 1."""
        sharp = self.template(0.25)
        if np.abs(sharp - np.rot90(sharp)).max() < 0.02:
            return 1
        return 2 if np.abs(sharp - np.rot90(sharp, 2)).max() < 0.02 else 4


def gaps_to_points(corners: Array, points: Array) -> Array:
    """(n,) depth of points (n, 2) inside a clockwise convex polygon (k, 2), in its unit; negative outside."""
    edge = np.roll(corners, -1, axis=0) - corners
    normal = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
    result: Array = (points @ normal.T - np.sum(normal * corners, axis=1)).min(axis=1)
    return result
