"""What corners and edges say for a map of the pad's plane and against it. Each test returns its refusal or None.

The corners of the contours that led to the map: area ratios, concentricity, shape. The edges of the whole drawing,
point by point, which neither shadows nor a partial cover take away. What the picture says is in picture and agreement.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from app.vision.fit import Fit, apply
from app.vision.geometry import LandmarkGeometry
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
FEWEST_POINTS = 24
"""Edge points that must be confirmed at all."""
MIN_SHARE = 0.6
"""Part of the edge points in view that must be confirmed: a quarter may be covered, some are lost in glare."""
MIN_SHARE_IN_PLACES = 0.4
"""The same where the picture vouches place by place."""
MIN_HEADING_SHARE = 0.5
MIN_HEADING_POINTS = 8
"""So many of the points on contours that look different when the landmark is turned, and this part of those in view;
and of those on slanted sides by themselves, where the landmark has any: the rest could be a square in a square."""
CONTOUR_POINTS = 8
CONTOUR_MISSING = 0.3
NEIGHBOUR_WHOLE = 0.85
"""A contour is missing if less than the one part of it is confirmed, though a neighbour is whole by the other: what
covers a contour covers some of its neighbours too."""
BENT_MAX = 0.08
"""What a lens that is not as its file says may bend the plane by."""
ABSENT = 0.2
SANDWICHED = 0.65
"""Between neighbours that are whole so much of a contour must be there; also of the innermost in a whole one."""
OUTERMOST_ALONE = 0.75
"""And none is absent where all others together are whole; the outermost, that no cover hides alone, where they are by
this part."""

OUTER_LEAST = 0.6
"""So much of the contours round some that are whole by OUTERMOST_ALONE must be there. Shadows, glare and covers from
one side leave 0.68 and more of them; straps along two sides leave a third, and cost the landmark."""


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
    """Whether a contour is not as drawn though those next to it are, or all within it: nothing can cover it alone."""
    for k, other in _missing(edges, geometry, SANDWICHED, any_neighbour=False):
        return _not_there(k, other, edges, geometry)
    for k in np.flatnonzero(edges.in_view >= 2 * CONTOUR_POINTS).tolist():
        others = int(edges.in_view.sum() - edges.in_view[k])
        confirmed = int(edges.confirmed.sum() - edges.confirmed[k])
        whole = NEIGHBOUR_WHOLE if k else OUTERMOST_ALONE
        if edges.confirmed[k] < ABSENT * edges.in_view[k] and confirmed > whole * others > 0:
            return _not_there(k, 0 if k else 1, edges, geometry)
    return _check_outer(edges, geometry)


def _check_outer(edges: Edges, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether what lies round contours that are whole is there as well."""
    for k in range(2, len(edges.in_view)):
        seen, inner = int(edges.in_view[:k].sum()), int(edges.in_view[k:].sum())
        there, whole = int(edges.confirmed[:k].sum()), int(edges.confirmed[k:].sum())
        if min(seen, inner) >= 4 * CONTOUR_POINTS and there < OUTER_LEAST * seen and whole > OUTERMOST_ALONE * inner:
            name = geometry.landmark.contours[k].name
            text = f"what lies round {name} is not as drawn ({there / seen * 100:.0f}% of its sides), though {name} is"
            return Rejection(Refusal.SIDES, text)
    return None


def heading_is_open(edges: Edges, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether the edges alone leave the heading open."""
    turns = geometry.turns_visibly
    seen, confirmed = int(edges.in_view[turns].sum()), int(edges.confirmed[turns].sum())
    if confirmed < max(MIN_HEADING_POINTS, MIN_HEADING_SHARE * seen):
        text = f"heading open: {confirmed} of {seen} points that would tell are as drawn"
        return Rejection(Refusal.HEADING, text)
    slanted, there = edges.slanted_in_view, edges.slanted_confirmed
    if geometry.point_slanted.any() and there < max(MIN_HEADING_POINTS, MIN_HEADING_SHARE * slanted):
        text = f"could be squares alone: {there} of {slanted} points on slanted sides are as drawn"
        return Rejection(Refusal.HEADING, text)
    return None
