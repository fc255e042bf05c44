"""What small landmarks are told by at a first glance: a coarse grid of samples on the patch, the drawing there in four
headings, and lines across it where a shadow's edge may lie.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.landmark import Landmark, Shape
from app.vision.template import PATCH, PATCH_EXTENT, Template

GRID = PATCH // 2
"""Samples along the patch."""
ANGLES = 8
OFFSETS = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
"""Half sides of the outermost contour from its middle to where a shadow's edge may lie across it."""
CENTRED = 0.02
"""Sides of the outermost contour that another's middle may lie off its own."""


class Glance:
    """The samples of one landmark, and the drawing there.

    Args:
        landmark: The drawing.
        extent: Of the part of it that is compared, in sides of the outermost contour.
    """

    def __init__(self, landmark: Landmark, extent: float) -> None:
        self._landmark = landmark
        self._extent = extent
        self._templates: dict[float, Array] = {}

    @cached_property
    def second_part(self) -> float | None:
        """Side of the second contour in sides of the outermost, if it is a square in the middle of it."""
        if len(self._landmark.contours) < 2:
            return None
        second = self._landmark.contours[1]
        centred = float(np.abs(second.centroid_m).max()) < CENTRED * self._landmark.size_m
        return second.side_m / self._landmark.size_m if second.shape is Shape.SQUARE and centred else None

    @cached_property
    def _cells(self) -> NDArray[np.bool_]:
        """(GRID, GRID) samples that are compared: the quiet zone's inner part and what it holds."""
        at = PATCH_EXTENT * (1.0 - (2.0 * np.arange(GRID) + 1.0) / GRID)
        near = np.abs(at) < min(self._extent, self._landmark.quiet_zone_m / self._landmark.size_m)
        return np.asarray(near[:, None] & near)

    @cached_property
    def grid(self) -> Array:
        """(m, 2) those samples' places, forward and right, in half sides of the outermost contour."""
        at = PATCH_EXTENT * (1.0 - (2.0 * np.arange(GRID) + 1.0) / GRID)
        forward, right = np.meshgrid(at, -at, indexing="ij")
        return np.column_stack([forward[self._cells], right[self._cells]])

    @cached_property
    def halves(self) -> Array:
        """(lines, m) 1 for the samples on one side of a line across the landmark, 0 for the others."""
        forward, right = self.grid.T
        found = []
        for angle in math.pi * np.arange(ANGLES) / ANGLES:
            across = math.cos(angle) * forward + math.sin(angle) * right
            found += [across > offset for offset in OFFSETS]
        return np.array(found, dtype=np.float64)

    def templates(self, template: Template) -> Array:
        """(4, m) the drawing at those samples, of mean 0 and length 1, turned so that its corner k takes the place of
        the first one.
        """
        key = template.sigma_cells
        if key not in self._templates:
            small = template.white.reshape(GRID, PATCH // GRID, GRID, -1)
            turned = [np.rot90(small.mean(axis=(1, 3)), turn)[self._cells] for turn in range(4)]
            rows = np.stack(turned) - np.mean(turned, axis=1, keepdims=True)
            self._templates[key] = rows / np.sqrt((rows * rows).sum(axis=1, keepdims=True))
        return self._templates[key]
