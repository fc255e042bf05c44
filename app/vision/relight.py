"""A shadow's straight edge across the landmark, found and taken out: the picture as one light would show it.

Over the small piece of ground that a landmark covers the edge of a shadow is a line, however the shadow looks
elsewhere. On either side of it the drawing is seen with a black and a white of its own; between them the light passes
from one to the other over the penumbra and the blur. The line with the four levels that explain the rectified patch
best is found, and the image is brought to the brighter side's levels, so that what proves a landmark in even light can
judge it: all of the picture against all of the drawing, instead of place by place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.messages import Image
from app.vision.fit import project_pad
from app.vision.geometry import LandmarkGeometry
from app.vision.patch import SATURATED_DN, Patch, View
from app.vision.template import PATCH, PATCH_EXTENT, PSF_SIGMA_PX, cell_centres

ANGLES = 16
"""Directions in which the edge is sought at first, over half a circle."""
FEWEST_CELLS = 40
"""On either side of it."""
EXPLAINED = 0.75
"""Correlation of the patch with the drawing in two lights, under which there is nothing to take a shadow out of."""
GAIN = 0.6
"""The two lights must leave less than this part of what one light leaves unexplained."""
DIMMEST, BRIGHTEST = 0.06, 0.85
"""Contrast in the shade over that in the light: in less nothing is seen, with more there is no shadow."""
LIFTED = 0.1
"""In the shade black may be brighter than in the light by this part of the contrast there: errors of the fit."""
MIN_CONTRAST_DN = 10.0
"""In the shade."""
SOFT_PX = (0.8, 2.0, 5.0)
"""Widths of the edge (standard deviation of its blur) that are tried first."""
FINEST = 0.004
"""Half sides of the patch: the last step of the line's search."""
BOX = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
"""The patch's corners, half sides of it."""
MARGIN_PX, MARGIN_PART = 6.0, 0.25
"""Of the image that is relit, round the patch; pixels and sides of it."""


@dataclass(frozen=True, slots=True)
class ShadowEdge:
    """The edge and the light on both its sides. Lengths are half sides of the patch.

    Attributes:
        angle: Of its normal, that points to the brighter side, from forward to right, rad.
        offset: Of the line along the normal from the patch's middle.
        soft: Standard deviation of its blur.
        black: Grey of black in the shade and in the light.
        contrast: From black to white, in the shade and in the light.
    """

    angle: float
    offset: float
    soft: float
    black: tuple[float, float]
    contrast: tuple[float, float]


@cache
def _directions() -> tuple[Array, NDArray[np.intp], Array]:
    """(ANGLES,) angles; (ANGLES, cells) the order of all cells along each, and how far along it each of them lies."""
    x, y = cell_centres()
    angles = math.pi * np.arange(ANGLES) / ANGLES
    place = np.cos(angles)[:, None] * x + np.sin(angles)[:, None] * y
    order = np.argsort(place, axis=1, kind="stable")
    return angles, order, np.take_along_axis(place, order, axis=1)


def _left(sums: Array) -> Array:
    """Sum of squares that black and white of their own leave; sums (6, ...) of 1, w, w w, g, g w, g g."""
    n, w, ww, g, gw, gg = sums
    n = np.maximum(n, 1.0)
    spread = np.maximum(ww - w * w / n, 1e-9)
    both = gw - g * w / n
    result: Array = gg - g * g / n - np.where(both > 0.0, both * both / spread, 0.0)
    return np.maximum(result, 0.0)


def _first_line(grey: Array, white: Array, counts: NDArray[np.bool_]) -> tuple[float, float, float, float]:
    """Angle and offset of the sharp line that explains best; what it leaves and what one light leaves.

    Args:
        grey: (cells,) of the patch.
        white: (cells,) of the drawing.
        counts: (cells,) which of them are looked at.
    """
    angles, order, place = _directions()
    chosen = counts[order]
    order, place = order[chosen].reshape(ANGLES, -1), place[chosen].reshape(ANGLES, -1)
    terms = np.stack([white, white * white, grey, grey * white, grey * grey])
    before = np.empty((6, *order.shape))
    before[0] = np.arange(1, order.shape[1] + 1)
    np.cumsum(terms[:, order], axis=2, out=before[1:])
    whole = before[:, :, -1:]
    cut = slice(FEWEST_CELLS - 1, order.shape[1] - FEWEST_CELLS)
    left = _left(before[:, :, cut]) + _left(whole - before[:, :, cut])
    k, m = np.unravel_index(int(left.argmin()), left.shape)
    at = m + FEWEST_CELLS - 1
    offset = 0.5 * float(place[k, at] + place[k, at + 1])
    return float(angles[k]), offset, float(left[k, m]), float(_left(whole[:, 0, 0]))


def _light(across: Array, soft: float) -> Array:
    """Part of the bright side's light at a distance from the line (a logistic curve, near to a blurred step)."""
    result: Array = 1.0 / (1.0 + np.exp(np.clip(-1.702 / soft * across, -50.0, 50.0)))
    return result


class _Fitter:
    """Greys of those cells that count, and what the drawing has there."""

    def __init__(self, grey: Array, white: Array, counts: NDArray[np.bool_]) -> None:
        x, y = cell_centres()
        self._x, self._y = x[counts], y[counts]
        self._grey, self._white = grey[counts], white[counts]
        self.total = len(self._grey) * float(self._grey.var())

    def solve(self, angle: float, offset: float, soft: float) -> tuple[float, Array]:
        """What a line leaves, and (4,) black and contrast in the shade, the same added in the light."""
        lit = _light(math.cos(angle) * self._x + math.sin(angle) * self._y - offset, soft)
        terms = np.stack([np.ones_like(lit), self._white, lit, lit * self._white])
        normal = terms @ terms.T
        normal.flat[::5] += 1e-4 * len(lit)
        side = terms @ self._grey
        levels = np.asarray(np.linalg.solve(normal, side), dtype=np.float64)
        off = self._grey - levels @ terms
        return float(off @ off), levels

    def refine(self, angle: float, offset: float, soft: float) -> tuple[float, float, float]:
        """The line near one that leaves least: a pattern search."""
        best, _ = self.solve(angle, offset, soft)
        step = np.array([math.pi / ANGLES / 2.0, 0.06, 0.5])
        at = np.array([angle, offset, math.log(soft)])
        while step[1] > FINEST:
            moved = False
            for axis in range(3):
                for sign in (1.0, -1.0):
                    tried = at.copy()
                    tried[axis] += sign * step[axis]
                    left, _ = self.solve(float(tried[0]), float(tried[1]), math.exp(tried[2]))
                    if left < best:
                        best, at, moved = left, tried, True
                        break
            if not moved:
                step *= 0.4
        return float(at[0]), float(at[1]), math.exp(at[2])


def find_shadow_edge(patch: Patch, geometry: LandmarkGeometry) -> ShadowEdge | None:
    """The shadow's edge that explains a patch at a map that is nearly right; None if there is none."""
    if patch.leads_nowhere:
        return None
    counts = geometry.judged.ravel() & patch.seen.ravel()
    if patch.clipped is not None:
        counts &= ~patch.clipped
    if np.count_nonzero(counts) < 4 * FEWEST_CELLS:
        return None
    grey, white = patch.grey.ravel(), geometry.template(PSF_SIGMA_PX / patch.cell_px).white.ravel()
    angle, offset, left, one = _first_line(grey, white, counts)
    fitter = _Fitter(grey, white, counts)
    if left > GAIN * one or left > (1.0 - EXPLAINED**2) * fitter.total:
        return None
    per_px = 2.0 / (PATCH * patch.cell_px)
    soft = min(SOFT_PX, key=lambda px: fitter.solve(angle, offset, px * per_px)[0]) * per_px
    angle, offset, soft = fitter.refine(angle, offset, soft)
    black, contrast, more_black, more_contrast = fitter.solve(angle, offset, soft)[1].tolist()
    shade, light = (black, contrast), (black + more_black, contrast + more_contrast)
    if light[1] < shade[1]:
        angle, offset, shade, light = angle + math.pi, -offset, light, shade
    dim = shade[1] / max(light[1], 1e-6)
    if not DIMMEST < dim < BRIGHTEST or shade[1] < MIN_CONTRAST_DN or shade[0] > light[0] + LIFTED * light[1]:
        return None
    return ShadowEdge(angle, offset, soft, (shade[0], light[0]), (shade[1], light[1]))


def relit(view: View, rays_from_pad: Array, edge: ShadowEdge) -> View | None:
    """The image round the landmark in the brighter light alone; None where the map leads out of it.

    Each pixel's ray is cut with the pad's plane, where the edge is straight. What is saturated stays so; what would be
    after the change is kept just under it.
    """
    half_m = 0.5 * PATCH_EXTENT * view.geometry.size_m
    px, valid = project_pad(rays_from_pad, half_m * BOX, view.lens)
    if not valid.all():
        return None
    corners = px - view.origin
    margin = MARGIN_PX + MARGIN_PART * float((corners.max(axis=0) - corners.min(axis=0)).max())
    height, width = view.image.shape
    u0, v0 = (max(0, math.floor(c)) for c in corners.min(axis=0) - margin)
    u1, v1 = (min(s, math.ceil(c)) for s, c in zip((width, height), corners.max(axis=0) + margin, strict=True))
    if u1 - u0 < 4 or v1 - v0 < 4:
        return None
    image = view.image[v0:v1, u0:u1]
    v, u = np.mgrid[v0:v1, u0:u1]
    rays = view.lens.rays(np.column_stack([u.ravel(), v.ravel()]) + np.asarray(view.origin, dtype=np.float64))
    pad = rays @ np.linalg.inv(rays_from_pad).T
    with np.errstate(invalid="ignore", divide="ignore"):
        forward, right = pad[:, 0] / pad[:, 2] / half_m, pad[:, 1] / pad[:, 2] / half_m
        across = math.cos(edge.angle) * forward + math.sin(edge.angle) * right - edge.offset
    # Beyond the lens's edge, or the pad's horizon, there is nothing to change.
    lit = _light(np.where(np.isfinite(across) & (pad[:, 2] > 0.0), across, math.inf), edge.soft).reshape(image.shape)
    black = edge.black[0] + (edge.black[1] - edge.black[0]) * lit
    contrast = edge.contrast[0] + (edge.contrast[1] - edge.contrast[0]) * lit
    grey = edge.black[1] + (image - black) * (edge.contrast[1] / contrast)
    shown: Image = np.clip(np.rint(grey), 0.0, SATURATED_DN - 1.0).astype(np.uint8)
    shown[image >= SATURATED_DN] = 255
    return replace(view, image=shown, origin=(view.origin[0] + u0, view.origin[1] + v0))
