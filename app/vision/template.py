"""A drawing as a picture to correlate with: on the cells of the rectified patch, at one blur, with the light and tone
that may be on it; and beside the drawings that it must not be taken for. What is drawn is in variants.
"""

from __future__ import annotations

from functools import cache, cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array

PATCH = 32
"""Cells along the rectified patch."""
PATCH_EXTENT = 1.3
"""The patch's side, in sides of the outermost contour: the quiet zone shows, and a little of what lies round it."""
SURROUND = 8.0
"""What lies round the quiet zone (grass) varies by this many times the noise on the landmark."""
WINDOW = 5
"""Cells along the window in which a place is compared."""
SHOWS = 0.1
"""Standard deviation of a drawing in a window, black 0 and white 1, from which it tells something."""
LIKE = 0.65
"""Squared correlation in a window that counts as agreement."""
PSF_SIGMA_PX = 0.75
"""Blur of a sharp lens and of the pixel's own area."""
BLUR_SIGMA_PX2 = 1.5
"""How much more variance of blur, in squared pixels, is expected along each direction."""
GRADIENT_SIGMA = 0.3
"""Gradient of the light over half a patch, as a part of the contrast."""
TONE_SIGMA = 0.4
"""Bend of the tone curve between black and white, as a part of the contrast."""
NOISE_PART = 0.1
"""Noise on a pixel, as a part of the contrast, against which these expectations weigh."""


def seen_blurred(drawings: NDArray[np.float32], sigma_cells: float) -> Array:
    """(n, PATCH, PATCH) what the cells see of drawings (n, m, m), each m / PATCH points along a cell, with a blur
    (standard deviation) of that many cells; past its border a drawing goes on as there.
    """
    points = drawings.shape[-1]
    fine = points // PATCH
    size = round(8.0 * sigma_cells * fine) | 1
    kernel = cv2.getGaussianKernel(size, sigma_cells * fine)
    # A Gaussian's two directions are separate: as matrices, with the mean over a cell in them, they act on all at once.
    spread = cv2.sepFilter2D(np.eye(points), -1, np.ones(1), kernel, borderType=cv2.BORDER_REPLICATE)
    along = np.asarray(spread.reshape(PATCH, fine, points).mean(axis=1), dtype=np.float32)
    return np.asarray(along @ drawings @ along.T, dtype=np.float64)


def appearances(white: Array, outside: Array) -> Array:
    """(n, 9, cells) what the grey of a patch is made of, for drawings of how white the cells are (n, PATCH, PATCH) and
    how much of them lies outside the quiet zone (PATCH, PATCH): white print; outside; half the second derivatives of
    the white print by row twice, by column twice and by both; its tone curve's bend; its gradient forward and right;
    one.
    """
    by_row, by_column = np.gradient(white, axis=(1, 2))
    row_row, row_column = np.gradient(by_row, axis=(1, 2))
    x, y = (c.reshape(PATCH, PATCH) for c in cell_centres())
    found = np.empty((len(white), 9, PATCH, PATCH))
    found[:, 0], found[:, 1], found[:, 8] = white, outside, 1.0
    found[:, 2], found[:, 3], found[:, 4] = 0.5 * row_row, 0.5 * np.gradient(by_column, axis=2), row_column
    found[:, 5] = 4.0 * white * (1.0 - white) * (1.0 - outside)
    found[:, 6], found[:, 7] = white * x, white * y
    return found.reshape(len(white), 9, -1)


class Template:
    """The drawing on the cells of the rectified patch, blurred.

    Attributes:
        white: (PATCH, PATCH) how much of each cell is white print, 0 black to 1.
        outside: (PATCH, PATCH) how much of it lies outside the quiet zone.
        sigma_cells: Its blur.
    """

    def __init__(self, white: Array, outside: Array, sigma_cells: float) -> None:
        self.white, self.outside = white, outside
        self.sigma_cells = sigma_cells
        self._slopes: tuple[Array, Array] | None = None
        self._kept: tuple[NDArray[np.intp], Array, Array] | None = None

    @cached_property
    def appearance(self) -> Array:
        """(cells, 9), see appearances."""
        result: Array = appearances(self.white[None], self.outside)[0].T
        return result

    def at(self, cells: NDArray[np.intp]) -> tuple[Array, Array]:
        """Appearance (k, 9) of some cells, and the inverse (9, 9) of its held normal equations; kept for next time."""
        kept = self._kept
        if kept is None or not np.array_equal(kept[0], cells):
            terms = self.appearance[cells]
            held = terms.T @ terms + np.diag(1e-6 * len(cells) + self.hold)
            kept = (cells, terms, np.asarray(np.linalg.inv(held), dtype=np.float64))
            self._kept = kept
        return kept[1], kept[2]

    @cached_property
    def hold(self) -> Array:
        """(9,) how strongly each term of the appearance is held near 0, against one cell's grey."""
        cell_px = PSF_SIGMA_PX / self.sigma_cells
        blur = (NOISE_PART * cell_px**2 / (0.5 * BLUR_SIGMA_PX2)) ** 2
        tone, gradient = (NOISE_PART / TONE_SIGMA) ** 2, (NOISE_PART / GRADIENT_SIGMA) ** 2
        return np.array([0.0, 0.0, blur, blur, blur, tone, gradient, gradient, 0.0])

    @cached_property
    def trust(self) -> Array:
        """(cells,) weights: what lies round the quiet zone may be anything."""
        return np.asarray(1.0 / (1.0 + (SURROUND * self.outside.ravel()) ** 2), dtype=np.float64)

    @cached_property
    def design(self) -> Array:
        """(8 + 8 + 9, cells): slopes of white, slopes of outside, appearance: all that an alignment needs."""
        return np.ascontiguousarray(np.concatenate([*(s.T for s in self.slopes()), self.appearance.T]))

    @cached_property
    def weighted_design(self) -> Array:
        """Design times trust."""
        return np.ascontiguousarray(self.design * self.trust)

    @cached_property
    def gram(self) -> Array:
        """(25, 25) weighted_design design^T of the whole patch."""
        result: Array = self.weighted_design @ self.design.T
        return result

    def slopes(self) -> tuple[Array, Array]:
        """(cells, 8) each: derivatives of white and outside by the terms of a homography (a b c; d e f; g h).

        Coordinates are half sides of the patch, forward and right; the drawing is sampled at the moved place.
        """
        if self._slopes is None:
            half = PATCH / 2.0
            x, y = cell_centres()
            found = []
            for drawing in (self.white, self.outside):
                by_row, by_column = np.gradient(drawing)
                along, across = (-by_row * half).ravel(), (by_column * half).ravel()
                radial = along * x + across * y
                terms = [along * x, along * y, along, across * x, across * y, across, -radial * x, -radial * y]
                found.append(np.column_stack(terms))
            self._slopes = found[0], found[1]
        return self._slopes


class Windows:
    """Drawings in a small window round each cell.

    Attributes:
        white: (n, PATCH, PATCH) how white each cell is.
        mean: (n, PATCH, PATCH) in the windows.
        safe: (n, PATCH, PATCH) variance in the windows, never 0.
        shows: (n, PATCH, PATCH) where a drawing tells something.
        differs: (n, PATCH, PATCH) where the first one and each would not be taken for each other.
    """

    def __init__(self, white: Array) -> None:
        def mean(values: Array) -> Array:
            return np.stack([cv2.blur(v, (WINDOW, WINDOW)) for v in values])

        self.white = white
        self.mean = mean(white)
        variance = mean(white * white) - self.mean**2
        self.safe: Array = np.maximum(variance, 1e-6)
        self.shows: NDArray[np.bool_] = variance > SHOWS * SHOWS
        both = mean(white * white[0]) - self.mean * self.mean[0]
        alike = (both > 0) & (both * both >= LIKE * self.safe * self.safe[0])
        self.differs: NDArray[np.bool_] = np.where(self.shows & self.shows[0], ~alike, self.shows != self.shows[0])


class Rivals:
    """Other drawings that the landmark must not be taken for, at one blur.

    Attributes:
        names: What they are, for people.
        must_differ: (n,) where a rival can't be told from the landmark, nothing is known: it is the landmark turned.
        white: (n, PATCH, PATCH) how white the cells are; the first one is the landmark itself.
        templates: The same, one by one.
        contour: (n,) the outermost one that differs.
        reshaped: (n,) whether nothing but the innermost contour's shape differs.
    """

    def __init__(
        self,
        names: list[str],
        must_differ: list[bool],
        own: Template,
        others: Array,
        contour: list[int],
        reshaped: list[bool],
    ) -> None:
        self.names = names
        self.contour = np.array(contour)
        self.must_differ = np.array(must_differ)
        self.reshaped = np.array(reshaped)
        self.white = np.concatenate([own.white[None], others])
        self.templates = [own, *(Template(white, own.outside, own.sigma_cells) for white in others)]
        self._kept: tuple[NDArray[np.intp], Array, Array] | None = None

    @cached_property
    def windows(self) -> Windows:
        """What each shows place by place."""
        return Windows(self.white)

    @cached_property
    def averaged(self) -> Array:
        """(n, PATCH, PATCH) how white each cell and its neighbours are."""
        return np.stack([cv2.blur(white, (3, 3)) for white in self.white])

    def left(self, values: Array, cells: NDArray[np.intp]) -> Array:
        """(n, k) sums of squares that each drawing leaves of some greys, with the appearance that suits it best.

        Args:
            values: (cells, k) k lists of greys.
            cells: Where they are; in most patches the same ones, whose part of the work is kept.
        """
        kept = self._kept
        if kept is None or not np.array_equal(kept[0], cells):
            terms = appearances(self.white, self.templates[0].outside)[:, :, cells]
            normal = terms @ terms.transpose(0, 2, 1)
            inverse = np.linalg.inv(normal + np.diag(1e-6 * len(cells) + self.templates[0].hold))
            kept = cells, terms.reshape(-1, len(cells)), inverse @ (2.0 * np.eye(len(normal[0])) - normal @ inverse)
            self._kept = kept
        _, rows, solved = kept
        side = (rows @ values).reshape(len(solved), -1, values.shape[1])
        result: Array = (values * values).sum(axis=0) - (side * (solved @ side)).sum(axis=1)
        return result


@cache
def cell_centres() -> tuple[Array, Array]:
    """(cells,) forward and right of the cells, in half sides of the patch."""
    cell = 1.0 - (2.0 * np.arange(PATCH) + 1.0) / PATCH
    x, y = np.meshgrid(cell, -cell, indexing="ij")
    return x.ravel(), y.ravel()
