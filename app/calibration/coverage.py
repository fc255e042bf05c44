"""Which views are worth fitting, and which part of the image they cover. It knows nothing of lenses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.calibration.board import NoView, View
from app.frames import Array
from app.messages import Image

GRID_COLUMNS = 8
"""Cells across an image; down so many that they come out about square."""
CELL_CORNERS = 2
"""A cell with this many corners, of all views together, is covered."""
NEW_DISTANCE = 0.1
"""A view this far from all others in the space of `features` adds something."""
VIEWS_MAX = 60
"""More views than this make a fit slower and hardly better: the error falls with the root of their number."""
BLUR_MAX_PX = 2.5
"""Sigma of the edges, for images of up to 1280 px; wider ones may be softer in proportion."""
BLUR_OVER_OTHERS = 1.8
"""A view this much softer than the better quarter of all is a blurred one."""
BLUR_FINE_PX = 1.2
"""Never refused for being softer than others."""
LIT_PART = 0.15
"""A cell that is never brighter than this part of the image's bright parts is outside the lens's image circle."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Cells over an image.

    Attributes:
        size_px: Width, height of the image.
        columns: Across.
        rows: Down.
    """

    size_px: tuple[int, int]
    columns: int
    rows: int

    @classmethod
    def over(cls, size_px: tuple[int, int]) -> Grid:
        """The grid of an image of this size."""
        return cls(size_px, GRID_COLUMNS, max(4, round(GRID_COLUMNS * size_px[1] / size_px[0])))

    def counts(self, px: Array) -> NDArray[np.int64]:
        """(rows, columns) how many of the points (n, 2) lie in each cell."""
        width, height = self.size_px
        found, _, _ = np.histogram2d(
            px[:, 1],
            px[:, 0],
            bins=(self.rows, self.columns),
            range=((-0.5, height - 0.5), (-0.5, width - 0.5)),
        )
        return found.astype(np.int64)

    def centres_px(self) -> Array:
        """(rows columns, 2) pixels in the middles of the cells, row by row."""
        width, height = self.size_px
        u = (np.arange(self.columns) + 0.5) * width / self.columns - 0.5
        v = (np.arange(self.rows) + 0.5) * height / self.rows - 0.5
        return np.column_stack([np.tile(u, self.rows), np.repeat(v, self.columns)])


def lit_cells(brightest: Image, grid: Grid) -> NDArray[np.bool_]:
    """(rows, columns) where the lens gives light at all.

    Args:
        brightest: (h, w) the brightest that each pixel was, of an image of any size.
        grid: Cells.
    """
    small = cv2.resize(brightest, (grid.columns, grid.rows), interpolation=cv2.INTER_AREA).astype(np.float64)
    result: NDArray[np.bool_] = small >= LIT_PART * float(np.percentile(brightest, 90.0))
    return result


def features(view: View) -> Array:
    """(5,) where a view's board lies, how large, and how it is foreshortened, by its outline alone.

    Place in the image in image widths; size as half the power of two; how much longer its right side is than its left
    and its lower than its upper, likewise. All count about equally for what a view adds.
    """
    corners = view.corners_m[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    unit = ((corners - low) / (high - low)).astype(np.float64)
    # A plane's map to the image, fitted to the corners that were found, gives the outline also where some are missing.
    x, y = unit.T
    one = np.ones_like(x)
    zero = np.zeros_like(x)
    u, v = view.px.T
    rows = np.concatenate(
        [
            np.column_stack([x, y, one, zero, zero, zero, -u * x, -u * y]),
            np.column_stack([zero, zero, zero, x, y, one, -v * x, -v * y]),
        ]
    )
    h, *_ = np.linalg.lstsq(rows, np.concatenate([u, v]), rcond=None)
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    depth = np.maximum(1.0 + square @ h[6:8], 0.05)
    outline = np.column_stack([(square @ h[0:2] + h[2]) / depth, (square @ h[3:5] + h[5]) / depth])
    top, right, bottom, left = (float(np.linalg.norm(outline[(k + 1) % 4] - outline[k])) + 1.0 for k in range(4))
    width = view.size_px[0]
    middle = view.px.mean(axis=0) / width
    size = math.log2(math.sqrt((top + bottom) * (left + right)) / width)
    return np.array([middle[0], middle[1], 0.5 * size, 0.5 * math.log2(right / left), 0.5 * math.log2(bottom / top)])


def sharp_enough(views: Sequence[View]) -> tuple[list[View], list[NoView]]:
    """Views that are not blurred, and those that are with the reason."""
    known = np.array([v.blur_px for v in views if v.blur_px > 0])
    usual = float(np.percentile(known, 25.0)) if len(known) else 0.0
    kept: list[View] = []
    refused: list[NoView] = []
    for view in views:
        fine = max(1.0, view.size_px[0] / 1280)
        limit = min(BLUR_MAX_PX * fine, max(BLUR_FINE_PX * fine, BLUR_OVER_OTHERS * usual))
        if view.blur_px > limit:
            words = f"blurred: edges of {view.blur_px:.1f} px (sigma), over {limit:.1f}; the sharper ones: {usual:.1f}"
            refused.append(NoView(view.name, words))
        else:
            kept.append(view)
    return kept, refused


def choose(views: Sequence[View], most: int = VIEWS_MAX) -> tuple[list[View], list[NoView]]:
    """The views that add most, the farthest from those already chosen first, sharper ones preferred.

    Returns:
        In the order of choice; and those that add nothing, or are too many, with the reason.
    """
    if not views:
        return [], []
    space = np.array([features(v) for v in views])
    blur = np.array([max(v.blur_px, 0.1) for v in views])
    worth = np.minimum(1.0, float(np.median(blur)) / blur) * np.sqrt([min(1.0, len(v.px) / 24) for v in views])
    first = int(np.argmax(worth))
    chosen, nearest_to = [first], np.full(len(views), first)
    distance = np.linalg.norm(space - space[first], axis=1)
    while len(chosen) < min(most, len(views)):
        best = int(np.argmax(distance * worth))
        if distance[best] < NEW_DISTANCE:
            break
        chosen.append(best)
        further = np.linalg.norm(space - space[best], axis=1)
        nearest_to = np.where(further < distance, best, nearest_to)
        distance = np.minimum(distance, further)
    taken = set(chosen)
    refused = [
        NoView(
            v.name,
            f"adds nothing to {views[nearest_to[i]].name}"
            if distance[i] < NEW_DISTANCE
            else f"not needed: {most} views that add more were chosen",
        )
        for i, v in enumerate(views)
        if i not in taken
    ]
    return [views[i] for i in chosen], refused
