"""The verdict on a map that was measured to sub-pixel: a landmark, or why not. Small landmarks are judged as a picture,
larger ones by their edges and by what the picture says where edges don't.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.agreement import MIN_AGREE, MIN_AGREE_WHOLE, check_agreement
from app.vision.align import Alignment, align
from app.vision.evidence import MIN_CONTRAST, check_contours, check_edges, check_sandwiched, heading_is_open
from app.vision.fit import project_pad
from app.vision.geometry import LandmarkGeometry
from app.vision.glare import is_blinded
from app.vision.patch import Patch, View, near_view, rectify, resemblance, side_px
from app.vision.picture import (
    WHOLE_MIN,
    Proof,
    check_innermost,
    check_inverted,
    check_likeness,
    check_picture,
)
from app.vision.refine import NEARLY_ALL, EdgeFit
from app.vision.refusal import Refusal, Rejection
from app.vision.shading import check_shaded

SMALL_PX = 60.0
"""Landmarks with a smaller outer side are fitted as a picture, larger ones by their edges: between the paper's two
innermost contours there are 2.7 pixels at this size."""
SMALLEST_PX = 9.5
AGAIN_MIN = 0.95
SAME = 0.99
"""Correlation of two looks, one frame apart, that show the same thing; noise alone takes 0.002 to 0.03 of it."""
UNSETTLED = 0.03
"""Correlation that the judge may find and the alignment's last step did not; with less rivals need not be asked."""
NEAR_MIN_PX = 24.0
INSIDE_MIN_PX = 40.0
"""Of a small landmark that large the inside is looked at from nearer."""
IN_PLACES_MAX_PX = 110.0
"""Larger landmarks show all their edges, and these decide."""
MIN_GAP_SEEN_PX = 1.0
CONTOUR_SHARE = 0.5
"""A contour counts as found if this part of its edge points is confirmed."""


@dataclass(frozen=True, slots=True)
class Least:
    """What a judgement place by place asks for.

    Attributes:
        agreeing: Part of the places that must agree with the drawing.
        shaded: Part of the cells that must be as drawn in their own light.
    """

    agreeing: float
    shaded: float


WHOLE, INSIDE = Least(MIN_AGREE_WHOLE, 0.88), Least(MIN_AGREE, 0.8)
"""Of the whole landmark, and of what lies inside the second contour."""


@dataclass(frozen=True, slots=True)
class Found:
    """A confirmed landmark.

    Attributes:
        rays_from_pad: (3, 3), see app.messages.PlaneFit.
        information: (8, 8), see there.
        residual_px: Root mean square distance of its edges from the drawing.
        contours: Which were found, outermost first, neighbours all.
        score: 0..1.
        side_px: Side of the outermost contour in the image.
        level: Grey half way from black to white.
        share: Part of the edge points in view that is confirmed, 1 for a small landmark.
        look: The picture of it, or of what lies inside its second contour.
        blind: Whether glare hides what lies inside: its heading is that of the frame before.
    """

    rays_from_pad: Array
    information: Array
    residual_px: float
    contours: range
    score: float
    side_px: float
    level: float
    share: float
    look: Patch
    blind: bool = False

    def corners_px(self, view: View) -> list[Array]:
        """For each contour found (k, 2), in the landmark's order."""
        geometry = view.geometry
        part = slice(geometry.slices[self.contours.start].start, geometry.slices[self.contours.stop - 1].stop)
        px, _ = project_pad(self.rays_from_pad, geometry.corners[part], view.lens)
        return [px[geometry.slices[k].start - part.start : geometry.slices[k].stop - part.start] for k in self.contours]

    def code(self, geometry: LandmarkGeometry) -> str:
        """Corner counts of the contours found."""
        return geometry.landmark.code[self.contours.start : self.contours.stop]


def _longest_run(good: NDArray[np.bool_]) -> range:
    """The longest stretch of true values."""
    best, start = range(0), 0
    for k in range(len(good) + 1):
        if k < len(good) and good[k]:
            continue
        if k - start > len(best):
            best = range(start, k)
        start = k + 1
    return best


def _visible(rays_from_pad: Array, run: range, view: View) -> range:
    """The inner part of a run whose corners the lens can see at all."""
    for start in run:
        rest = range(start, run.stop)
        part = slice(view.geometry.slices[rest.start].start, view.geometry.slices[rest.stop - 1].stop)
        if project_pad(rays_from_pad, view.geometry.corners[part], view.lens)[1].all():
            return rest
    return range(0)


def judge_edges(fit: EdgeFit, view: View, before: Patch | None = None, led: bool = False) -> Found | Rejection:
    """A fit by its edges, confirmed or refused.

    Args:
        fit: The fit.
        view: What it was made on.
        before: Its look when it was confirmed in the frame before: if its edges are nearly all there and it looks the
            same, that is enough.
        led: The map comes from the frame before: where glare hides what lies inside, the outer contours are enough.
    """
    found = _judge_edges(fit, view, before)
    if isinstance(found, Rejection) and led and is_blinded(fit, view):
        look = _look(fit, view)
        return replace(_outer(fit, look), blind=True)
    return found


def _outer(fit: EdgeFit, look: Patch) -> Found:
    """The two outer contours."""
    edges = fit.edges
    return Found(
        fit.rays_from_pad,
        fit.information,
        edges.scatter_px,
        range(2),
        edges.share,
        edges.side_px,
        edges.level,
        edges.share,
        look,
    )


def _judge_edges(fit: EdgeFit, view: View, before: Patch | None) -> Found | Rejection:
    """As judge_edges, without a lead."""
    geometry, edges = view.geometry, fit.edges
    refused = check_edges(edges) or check_sandwiched(edges, geometry)
    if refused is not None:
        return refused
    score = edges.share
    open_yet = check_contours(edges, geometry) or heading_is_open(edges, geometry)
    look = _look(fit, view)
    if before is not None and open_yet is None and edges.share > NEARLY_ALL and resemblance(before, look) > SAME:
        return _found(fit, score, look, view)
    patch = rectify(view, fit.rays_from_pad)
    refused = open_yet or check_inverted(patch, geometry) or check_likeness(patch, geometry)
    first = _first_inside(fit, geometry)
    inside = None if first is None else _prove_inside(fit, first, view)
    if inside is not None and inside.rejection is not None and inside.mimic:
        return inside.rejection
    unproven = inside is not None and inside.rejection is not None
    # A small one comes here when its picture as a whole failed: its few edges alone don't prove it.
    if side_px(patch) < (SMALL_PX if refused is None else IN_PLACES_MAX_PX):
        unproven = side_px(patch) >= NEAR_MIN_PX
        proof = check_in_places(patch, geometry, WHOLE, 2 if unproven and first is not None else None)
        refused, score = proof.rejection, proof.correlation
        first = 2
    elif first is not None and first == len(geometry.points_of) - 1:
        # Edges show all contours: what partly covers the innermost is seen in its surroundings.
        first = max(2, first - 2)
        if unproven and refused is None:
            inside = _prove_inside(fit, first, view)
            if inside is not None and inside.rejection is not None and inside.mimic:
                return inside.rejection
            unproven = inside is None or inside.rejection is not None
    if refused is None and unproven and first is not None:
        # Once more from nearer, where the heading and the innermost contours are.
        near, matrix = near_view(view, fit.rays_from_pad, first)
        refused = check_in_places(rectify(near, matrix), near.geometry, INSIDE).rejection
    if refused is None:
        refused = _another_innermost(fit, view)
    if refused is not None:
        return refused
    proven = None if inside is None or inside.rejection is not None else first
    return _found(fit, score, look, view, proven)


def _look(fit: EdgeFit, view: View) -> Patch:
    """The picture inside the second contour, or of all if there is nothing."""
    if len(view.geometry.landmark.contours) < 3:
        return rectify(view, fit.rays_from_pad)
    return rectify(*near_view(view, fit.rays_from_pad, 2))


def _first_inside(fit: EdgeFit, geometry: LandmarkGeometry) -> int | None:
    """The black contour from which on the picture has to prove the drawing: the one with the first contour in it that
    edges don't show, or the innermost if they show all; None where there is none.
    """
    deepest = len(geometry.points_of) - 1
    if deepest < 2:
        return None
    hidden = np.flatnonzero(fit.edges.confirmed[2:] < 0.5 * geometry.points_of[2:])
    first = 2 + int(hidden[0]) if len(hidden) else deepest
    return first - first % 2


def _prove_inside(fit: EdgeFit, first: int, view: View) -> Proof | None:
    """What the picture from a contour on says, where all of it lies in the image; None where it doesn't."""
    geometry = view.geometry
    px, valid = project_pad(fit.rays_from_pad, geometry.corners[geometry.slices[first]], view.lens)
    height, width = view.image.shape
    if not valid.all() or (px < view.origin).any() or (px > np.array([width - 1, height - 1]) + view.origin).any():
        return None
    near, matrix = near_view(view, fit.rays_from_pad, first)
    aligned = align(near, matrix, 2)
    # Where most is saturated little holds the picture in place; the edges do.
    return check_picture(rectify(near, matrix) if aligned is None else aligned.patch, near.geometry)


def _another_innermost(fit: EdgeFit, view: View) -> Rejection | None:
    """Why the innermost contour is not the drawn one, where it is black and has others round it."""
    last = len(view.geometry.landmark.contours) - 1
    if last < 2 or not view.geometry.landmark.contours[last].black:
        return None
    near, matrix = near_view(view, fit.rays_from_pad, last)
    return check_innermost(rectify(near, matrix), near.geometry)


def _found(fit: EdgeFit, score: float, look: Patch, view: View, proven: int | None = None) -> Found | Rejection:
    """What was confirmed, with the contours that are whole enough, or proven by the picture from one on."""
    edges = fit.edges
    share = edges.confirmed / np.maximum(edges.in_view, 1)
    whole = (share >= CONTOUR_SHARE) & (edges.in_view > 0)
    if proven is not None:
        whole[proven:] = True
    run = _longest_run(whole)
    run = _visible(fit.rays_from_pad, run, view)
    if len(run) < 2:
        return Rejection(Refusal.CODE, f"{len(run)} contour is whole enough, under 2")
    return Found(
        fit.rays_from_pad, fit.information, edges.scatter_px, run, score, edges.side_px, edges.level, edges.share, look
    )


def check_in_places(patch: Patch, geometry: LandmarkGeometry, least: Least, deepest: int | None = None) -> Proof:
    """Whether a patch that a shadow or a cover may cross shows the drawing place by place, in windows or, where these
    can't tell it from a rival, cell by cell.
    """
    windows = check_agreement(patch, geometry, least.agreeing, deepest)
    if windows.rejection is None or windows.mimic or windows.rejection.test < Refusal.INNER_CORRELATION:
        return windows
    cells = check_shaded(patch, geometry, least.shaded, deepest)
    if cells.rejection is None or cells.rejection.test > windows.rejection.test:
        return cells
    return windows


def _mimic_inside(rays_from_pad: Array, view: View) -> Rejection | None:
    """Why what lies inside the second contour is something else, seen from nearer: of the whole picture it is a few
    cells.
    """
    if len(view.geometry.landmark.contours) < 3:
        return None
    near, matrix = near_view(view, rays_from_pad, 2)
    proof = check_picture(rectify(near, matrix), near.geometry)
    return proof.rejection if proof.mimic else None


def judge_alignment(aligned: Alignment, view: View, before: Patch | None = None) -> Found | Rejection:
    """An alignment, confirmed or refused; before is its look when it was confirmed in the frame before: if it looks the
    same, that is enough.
    """
    geometry, patch = view.geometry, aligned.patch
    size_px = side_px(patch)
    if size_px < SMALLEST_PX:
        return Rejection(Refusal.TOO_SMALL, f"side {size_px:.1f} px, under {SMALLEST_PX:.1f} px")
    score = aligned.correlation
    if score < WHOLE_MIN - UNSETTLED:
        text = f"correlation with the drawn landmark {score:.3f}, under {WHOLE_MIN - UNSETTLED:.3f}"
        return Rejection(Refusal.CORRELATION, text)
    same = before is not None and score > AGAIN_MIN and resemblance(before, patch) > SAME
    if not (same and aligned.contrast > MIN_CONTRAST):
        proof = check_picture(patch, geometry)
        score = proof.correlation
        if proof.rejection is not None:
            return proof.rejection
        mimic = _mimic_inside(aligned.rays_from_pad, view) if size_px >= INSIDE_MIN_PX else None
        if mimic is not None:
            return mimic
    count = len(geometry.landmark.contours)
    resolved = 2
    while resolved < count and geometry.outer_gap_m[resolved] * size_px / geometry.size_m >= MIN_GAP_SEEN_PX:
        resolved += 1
    return Found(
        aligned.rays_from_pad,
        aligned.information,
        aligned.scatter_dn / aligned.contrast,
        range(resolved),
        score,
        size_px,
        aligned.level,
        1.0,
        patch,
    )
