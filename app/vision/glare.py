"""A glare over the landmark: the sun mirrored in glossy print saturates what lies inside, and the frame before vouches
for it. White paper laid over the inside looks much the same, but lights up nothing round it.
"""

from __future__ import annotations

import math

import numpy as np

from app.vision.evidence import MIN_SHARE, check_edges
from app.vision.patch import SATURATED_DN, View, near_view, rectify
from app.vision.refine import EdgeFit
from app.vision.template import PSF_SIGMA_PX

BLINDED = 0.35
"""Part of what lies inside the second contour that is saturated, and of what is drawn black there that is bright, from
which the frame before vouches for it."""
BLIND_POINTS = 30
DRAWN_BLACK = 0.1
BLIND_CELLS = 16
"""Cells drawn black inside, below which blur leaves too little black to be missed."""
DARK_MOST = 0.03
"""Part of the white inside that may be dark in a glare."""
RING_LIT = 0.2
"""Brightest over darkest tenth of the ring round a glare, as a part of what there is up to saturation."""
ZONE_SATURATED = 0.5
"""Part of the quiet zone that is saturated from which the exposure may be to blame, not a glare: then the same holds
between RING_PARTS parts of the ring."""
RING_PARTS = 8


def is_blinded(fit: EdgeFit, view: View) -> bool:
    """Whether the outer contours are there, but most of what lies inside is saturated."""
    edges = fit.edges
    if check_edges(edges) is not None or len(edges.in_view) < 3:
        return False
    if int(edges.confirmed[:2].sum()) < max(BLIND_POINTS, MIN_SHARE * int(edges.in_view[:2].sum())):
        return False
    near, matrix = near_view(view, fit.rays_from_pad, 2)
    look = rectify(near, matrix)
    if look.clipped is None:
        return False
    drawn, inside = near.geometry.template(PSF_SIGMA_PX / look.cell_px).white.ravel(), near.geometry.cells(None)
    bright, drawn = (look.grey.ravel() > edges.level)[inside], drawn[inside]
    hidden = (look.clipped | ~look.seen.ravel())[inside]
    black = drawn < DRAWN_BLACK
    if int(black.sum()) < BLIND_CELLS or float(hidden.mean()) <= BLINDED:
        return False
    if float((hidden | bright)[black].mean()) <= BLINDED:
        return False
    # Nothing makes print blacker; and a glare lights up some of the ring round it too, where white paper does not.
    return float((hidden | bright)[drawn > 1.0 - DRAWN_BLACK].mean()) > 1.0 - DARK_MOST and _ring_is_lit(fit, view)


def _ring_is_lit(fit: EdgeFit, view: View) -> bool:
    """Whether the black between the two outer contours is much brighter in one place than in another."""
    patch, geometry = rectify(view, fit.rays_from_pad), view.geometry
    drawn = geometry.template(PSF_SIGMA_PX / patch.cell_px).white.ravel()
    outside, seen = ~geometry.inside(0).ravel(), patch.seen.ravel()
    ring = ~outside & ~geometry.inside(1).ravel() & (drawn < DRAWN_BLACK) & seen
    grey = patch.grey.ravel()
    if int(ring.sum()) < BLIND_POINTS:
        return False
    low, high = np.percentile(grey[ring], (10.0, 90.0))
    if high - low <= RING_LIT * (SATURATED_DN - low):
        return False
    zone = outside & geometry.judged.ravel() & (drawn > 1.0 - DRAWN_BLACK) & seen
    if patch.clipped is None or not zone.any() or float(patch.clipped[zone].mean()) < ZONE_SATURATED:
        return True
    # All white is saturated, and blur alone makes the ring's rims brighter, but on all sides alike.
    forward, right = geometry.patch_points.T
    part = (np.arctan2(right, forward) * (RING_PARTS / math.tau)).round().astype(int) % RING_PARTS
    means = [float(grey[ring & (part == k)].mean()) for k in range(RING_PARTS) if (ring & (part == k)).any()]
    return max(means) - min(means) > RING_LIT * (SATURATED_DN - min(means))
