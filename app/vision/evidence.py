"""What speaks for a map of the pad's plane and what against it. Each test returns its refusal or None.

Three kinds of evidence: the corners of the contours that led to the map (area ratios, concentricity, shape); the edges
of the whole drawing, point by point, which neither shadows nor a partial cover take away; and the picture inside, where
the drawing must explain the grey better than the drawing turned, or with a part of it upside down or missing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.align import Alignment
from app.vision.fit import Fit, apply
from app.vision.geometry import PSF_SIGMA_PX, LandmarkGeometry, Template
from app.vision.patch import Patch, side_px
from app.vision.refine import Edges
from app.vision.refusal import Refusal, Rejection

CORNER_ERROR_PX = 1.6
"""Corners of a binary image lie this far from the true ones at most, before they are refined."""
SHAPE_PART = 0.035
"""And this part of the outermost side in addition: bent prints, lens errors."""
AREA_SLACK = 1.22
"""Area ratios may differ by this factor beside what CORNER_ERROR_PX does."""
MIN_CONTRAST = 12.0
"""Grey levels between the landmark's black and its white."""
MAX_CONTRAST = 300.0
"""A blurred landmark's black and white, worked out from its greys, may lie somewhat beyond 0 and 255."""
FEWEST_POINTS = 24
"""Edge points that must be confirmed at all."""
MIN_SHARE = 0.6
"""Part of the edge points in view that must be confirmed: a quarter may be covered, some are lost in glare."""
MIN_SHARE_IN_PLACES = 0.4
"""The same where the picture vouches place by place."""
MIN_HEADING_SHARE = 0.5
MIN_HEADING_POINTS = 8
"""So many of the points on contours that look different when the landmark is turned, and this part of those in view."""
CONTOUR_POINTS = 8
CONTOUR_MISSING = 0.3
NEIGHBOUR_WHOLE = 0.85
"""A contour is missing if less than the one part of it is confirmed, though a neighbour is whole by the other: what
covers a contour covers some of its neighbours too."""
BENT_MAX = 0.08
"""What a lens that is not as its file says may bend the plane by."""
ABSENT = 0.2
SANDWICHED = 0.65
"""Between neighbours that are whole so much of a contour must be there; also of the innermost in a whole one. And none
is absent where all others together are whole."""
INVERTED = 0.014
"""Part of the outermost square that may be black for white and, at the same time, white for black. A cover is one or
the other; a triangle upside down is both, by 4% each."""
LIKE_MIN = 0.5
WHOLE_MIN = 0.945
FEW_MIN, FEWEST_PX, FEW_PX = 0.98, 12.0, 24.0
"""Correlation of a small landmark's patch with the drawing as this light and lens show it; and of one of
FEWEST_PX or less, rising from FEW_PX on."""
STRUCTURE_MAX = 0.065
"""What noise, blur and light don't explain, as a part of the contrast: rendered landmarks leave 0.01 to 0.05, those
with another ratio, or shifted or turned triangles 0.065 and more."""
AVERAGED_PX = 2.0
RIVAL_MARGIN = 0.15
"""Part of the difference that the drawing leads one to expect between itself and a rival."""
MIN_CELLS = 24
FLAT_PART = 0.03
"""What differs by less than this part of the contrast, root mean square, can't be told."""


def check_rectified(fit: Fit, first: int, count: int, geometry: LandmarkGeometry, scale_px: float) -> Rejection | None:
    """Area ratios and concentricity of a run, rectified by the fit; scale_px is pixels per metre on the pad.

    The limits widen where the corners are uncertain: an edge that is off by e all round changes the area of a square of
    side s by 4 e / s.
    """
    contours = geometry.landmark.contours
    inverse = np.asarray(np.linalg.inv(fit.basis @ fit.rays_from_pad), dtype=np.float64)
    flat = apply(inverse, fit.plane)
    begin = geometry.slices[first].start
    starts = [geometry.slices[k].start - begin for k in range(first, first + count)]
    following = geometry.following[begin : begin + len(flat)] - begin
    forward, right = flat[:, 0], flat[:, 1]
    areas = 0.5 * np.add.reduceat(forward * right[following] - forward[following] * right, starts)
    counts = np.diff([*starts, len(flat)])
    shifts = np.add.reduceat(flat, starts) / counts[:, None] - geometry.centroids[first : first + count]
    for i, k in enumerate(range(first, first + count - 1)):
        outer, inner = contours[k], contours[k + 1]
        error_m = 0.5 * CORNER_ERROR_PX / scale_px
        slack = AREA_SLACK + error_m * (4.0 / geometry.sides_m[k] + 4.0 / geometry.sides_m[k + 1])
        ratio = float(areas[i]) / max(float(areas[i + 1]), 1e-12)
        drawn = float(geometry.area_ratios[k])
        if not drawn / slack <= ratio <= drawn * slack:
            limits = f"{drawn / slack:.2f}..{drawn * slack:.2f}"
            text = f"area ratio {outer.name}:{inner.name} {ratio:.2f} outside {limits}"
            return Rejection(Refusal.AREA_RATIO, text)
        off_px, limit_px = (
            math.dist(shifts[i + 1], shifts[i]) * scale_px,
            CORNER_ERROR_PX + 0.04 * float(geometry.sides_m[k]) * scale_px,
        )
        if off_px > limit_px:
            text = f"{inner.name} in {outer.name} is {off_px:.1f} px off its place, over {limit_px:.1f} px"
            return Rejection(Refusal.NOT_CONCENTRIC, text)
    limit = CORNER_ERROR_PX + SHAPE_PART * float(geometry.sides_m[first]) * scale_px
    if fit.residual_px > limit:
        text = f"corners {fit.residual_px:.1f} px off the drawn landmark, over {limit:.1f} px"
        return Rejection(Refusal.SHAPE, text)
    return None


# ------------------------------------------------------------------------------------------------------------ edges
def check_edges(edges: Edges) -> Rejection | None:
    """Whether enough of the drawing's edges are there at all."""
    total = int(edges.confirmed.sum())
    if total < FEWEST_POINTS:
        return Rejection(Refusal.SIDES, f"{total} points of its sides are seen, under {FEWEST_POINTS}")
    if edges.contrast < MIN_CONTRAST:
        text = f"contrast {edges.contrast:.0f} grey levels, under {MIN_CONTRAST:.0f}"
        return Rejection(Refusal.CONTRAST, text)
    if edges.share < MIN_SHARE_IN_PLACES:
        text = f"{edges.share * 100:.0f}% of its sides are as drawn, under {MIN_SHARE_IN_PLACES * 100:.0f}%"
        return Rejection(Refusal.SIDES, text)
    if edges.bent > BENT_MAX:
        text = f"its two axes are not alike or not at right angles ({edges.bent:.2f}, over {BENT_MAX:.2f})"
        return Rejection(Refusal.SHAPE, text)
    return None


def check_contours(edges: Edges, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether the edges alone prove the drawing, contour by contour."""
    if edges.share < MIN_SHARE:
        text = f"{edges.share * 100:.0f}% of its sides are as drawn, under {MIN_SHARE * 100:.0f}%"
        return Rejection(Refusal.SIDES, text)
    for k, other in _missing(edges, geometry, CONTOUR_MISSING, any_neighbour=True):
        return _not_there(k, other, edges, geometry)
    return None


def _missing(
    edges: Edges, geometry: LandmarkGeometry, least: float, *, any_neighbour: bool
) -> Iterator[tuple[int, int]]:
    """Contours of which less than `least` is confirmed though a neighbour, or each of them, is whole; and which."""
    share = edges.confirmed / np.maximum(edges.in_view, 1)
    judged = edges.in_view >= CONTOUR_POINTS
    for k in np.flatnonzero(judged & (share < least)).tolist():
        beside = [n for n in (k - 1, k + 1) if 0 <= n < len(share) and judged[n]]
        whole = [n for n in beside if share[n] > NEIGHBOUR_WHOLE]
        if whole and (any_neighbour or whole == beside):
            yield k, whole[0]


def _not_there(k: int, other: int, edges: Edges, geometry: LandmarkGeometry) -> Rejection:
    names = [c.name for c in geometry.landmark.contours]
    share = edges.confirmed[k] / max(1, int(edges.in_view[k]))
    text = f"{names[k]} is not as drawn ({share * 100:.0f}% of its sides), though {names[other]} is"
    return Rejection(Refusal.SIDES, text)


def check_sandwiched(edges: Edges, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether a contour is not as drawn though those next to it are: nothing can cover it alone."""
    for k, other in _missing(edges, geometry, SANDWICHED, any_neighbour=False):
        return _not_there(k, other, edges, geometry)
    for k in np.flatnonzero(edges.in_view >= 2 * CONTOUR_POINTS).tolist():
        others = int(edges.in_view.sum() - edges.in_view[k])
        confirmed = int(edges.confirmed.sum() - edges.confirmed[k])
        if edges.confirmed[k] < ABSENT * edges.in_view[k] and confirmed > NEIGHBOUR_WHOLE * others > 0:
            return _not_there(k, 0 if k else 1, edges, geometry)
    return None


def heading_is_open(edges: Edges, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether the edges alone leave the heading open."""
    turns = geometry.turns_visibly
    seen, confirmed = int(edges.in_view[turns].sum()), int(edges.confirmed[turns].sum())
    if confirmed < max(MIN_HEADING_POINTS, MIN_HEADING_SHARE * seen):
        text = f"heading open: {confirmed} of {seen} points that would tell are as drawn"
        return Rejection(Refusal.HEADING, text)
    return None


def check_likeness(patch: Patch, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether a large landmark's patch resembles the drawing at all, shadows and covers allowed."""
    cells = _seen(patch, geometry.cells(None))
    if len(cells) < MIN_CELLS:
        return None
    found = explain(patch.grey.ravel()[cells], geometry.template(PSF_SIGMA_PX / patch.cell_px), cells)
    if found.correlation < LIKE_MIN:
        text = f"correlation with the drawn landmark {found.correlation:.2f}, under {LIKE_MIN:.2f}"
        return Rejection(Refusal.CORRELATION, text)
    return None


def check_inverted(patch: Patch, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether black stands for white in one place and white for black in another."""
    template = geometry.template(PSF_SIGMA_PX / patch.cell_px)
    cells = _seen(patch, geometry.cells(None))
    white, grey = template.white.ravel()[cells], patch.grey.ravel()[cells]
    black_cells, white_cells = white < 0.1, white > 0.9
    if not (black_cells.any() and white_cells.any()):
        return None
    low, high = float(np.median(grey[black_cells])), float(np.median(grey[white_cells]))
    if high - low < MIN_CONTRAST:
        return Rejection(Refusal.CONTRAST, f"contrast {high - low:.0f} grey levels, under {MIN_CONTRAST:.0f}")
    area = len(geometry.cells(None)) * geometry.square_part
    too_white = float((grey[black_cells] > high - 0.3 * (high - low)).sum()) / area
    too_black = float((grey[white_cells] < low + 0.3 * (high - low)).sum()) / area
    if min(too_white, too_black) > INVERTED:
        text = f"{too_white * 100:.1f}% is white for black and {too_black * 100:.1f}% black for white"
        return Rejection(Refusal.CORRELATION, text)
    return None


# ---------------------------------------------------------------------------------------------------------- picture
@dataclass(frozen=True, slots=True)
class Explained:
    """How a drawing explains cells of a patch, with the light, blur and tone that suit it best.

    Attributes:
        correlation: Of the cells with what the drawing makes of them; 0 if black and white are the wrong way round.
        left: Sum of squares that is left.
        contrast: Grey levels from black to white.
        model: (cells,) what it makes of them.
    """

    correlation: float
    left: float
    contrast: float
    model: Array


def _seen(patch: Patch, cells: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of the cells that lie in the image."""
    return cells if patch.whole else cells[patch.seen.ravel()[cells]]


def explain(grey: Array, template: Template, cells: NDArray[np.intp]) -> Explained:
    """Fit a drawing's appearance to the grey (n,) of some cells."""
    terms = template.appearance[cells]
    normal = terms.T @ terms
    normal.flat[:: len(normal) + 1] += 1e-6 * len(cells) + template.hold
    solution = np.linalg.solve(normal, terms.T @ grey)
    model = terms @ solution
    off = grey - model
    left = float(off @ off)
    total = float(grey @ grey) - len(grey) * float(grey.mean()) ** 2
    contrast = float(solution[0])
    correlation = math.sqrt(max(0.0, 1.0 - left / total)) if total > 1e-6 and contrast > 0 else 0.0
    return Explained(correlation, left, contrast, model)


def check_aligned(aligned: Alignment, geometry: LandmarkGeometry) -> tuple[Rejection | None, float]:
    """Whether the drawing explains an aligned patch, and no rival does as well; and its correlation with the patch."""
    patch = aligned.patch
    sigma = PSF_SIGMA_PX / patch.cell_px
    cells = _seen(patch, geometry.cells(None))
    if len(cells) < MIN_CELLS:
        return Rejection(Refusal.TOO_SMALL, "too little of it lies in the image"), 0.0
    grey = patch.grey.ravel()[cells]
    best = explain(grey, geometry.template(sigma), cells)
    if best.contrast < MIN_CONTRAST:
        text = f"contrast {best.contrast:.0f} grey levels, under {MIN_CONTRAST:.0f}"
        return Rejection(Refusal.CONTRAST, text), best.correlation
    if best.contrast > MAX_CONTRAST:
        text = f"contrast {best.contrast:.0f} grey levels, over {MAX_CONTRAST:.0f}: no print is whiter than white"
        return Rejection(Refusal.CONTRAST, text), best.correlation
    # Few pixels are easily explained.
    few = (FEW_PX - side_px(patch)) / (FEW_PX - FEWEST_PX)
    least = WHOLE_MIN + (FEW_MIN - WHOLE_MIN) * min(1.0, max(0.0, few))
    if best.correlation < least:
        text = f"correlation with the drawn landmark {best.correlation:.3f}, under {least:.3f}"
        return Rejection(Refusal.CORRELATION, text), best.correlation
    structure = _structure(patch, cells, grey - best.model) / best.contrast
    if structure > STRUCTURE_MAX:
        text = (
            f"what differs from the drawing is {structure * 100:.1f}% of the contrast, over {STRUCTURE_MAX * 100:.1f}%"
        )
        return Rejection(Refusal.CORRELATION, text), best.correlation
    rivals = geometry.rivals(sigma)
    expected, found = rivals.left(np.column_stack([best.model, grey]), cells).T
    expected, found = expected - expected[0], found - found[0]
    same = expected < len(cells) * (FLAT_PART * best.contrast) ** 2
    # A rival that can't be told from the landmark says nothing, but for the landmark turned.
    wrong = np.where(same, rivals.must_differ, found < RIVAL_MARGIN * expected)
    wrong[0] = False
    if wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        text = (
            f"could as well be the landmark {rivals.names[k]}: "
            f"{found[k] / max(expected[k], 1e-9) * 100:.0f}% of the difference to expect"
        )
        refusal = Refusal.HEADING if rivals.must_differ[k] else Refusal.INNER_CORRELATION
        return Rejection(refusal, text), best.correlation
    return None, best.correlation


def _structure(patch: Patch, cells: NDArray[np.intp], off: Array) -> float:
    """Root mean square, in grey levels, of what differs, averaged over some pixels: noise averages out, another drawing
    doesn't.
    """
    spread = np.zeros(patch.grey.size)
    spread[cells] = off
    window = max(3, round(AVERAGED_PX / patch.cell_px) | 1)
    smooth = cv2.blur(spread.reshape(patch.grey.shape), (window, window)).ravel()[cells]
    return math.sqrt(float(smooth @ smooth) / len(cells))
