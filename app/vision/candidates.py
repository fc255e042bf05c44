"""From hypotheses to the landmark: maps of the pad's plane that may be right are measured to sub-pixel and judged.

A hypothesis comes from nested polygons (the paper's way, read by Table I), from the frame before, or from the other
finders; what confirms it is the same for all. Small landmarks are fitted as a picture, larger ones by their edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.agreement import MIN_AGREE, MIN_AGREE_WHOLE, check_agreement
from app.vision.align import STEPS, Alignment, align
from app.vision.contours import Nest
from app.vision.evidence import (
    MIN_CONTRAST,
    check_contours,
    check_edges,
    check_rectified,
    check_sandwiched,
    heading_is_open,
)
from app.vision.fit import fit_run, project_pad
from app.vision.geometry import LandmarkGeometry
from app.vision.glare import is_blinded
from app.vision.patch import Patch, View, near_view, rectify, resemblance, side_px
from app.vision.picture import WHOLE_MIN, Explained, Proof, check_inverted, check_likeness, check_picture, explain_patch
from app.vision.refine import FINE_REACH_PX, NEARLY_ALL, EdgeFit, fit_edges
from app.vision.refusal import Refusal, Rejection
from app.vision.relight import find_shadow_edge, relit
from app.vision.shading import check_shaded
from app.vision.table import Alignment as Reading
from app.vision.table import alignments

SMALL_PX = 60.0
"""Landmarks with a smaller outer side are fitted as a picture, larger ones by their edges: between the paper's two
innermost contours there are 2.7 pixels at this size."""
SMALLEST_PX = 9.5
FIRST_REACH_PX = 4.0
NEXT_REACH_PX = 3.0
REACH_PART = 0.012
"""Where sides are still missing they are sought this part of the outer side away, nearer in steps."""
PARTIAL_REACHES_PX = (12.0, 6.0)
PARTIAL_POINTS = 12
PARTIAL_SHARE = 0.6
EASY_PX = 3.2
"""A landmark whose edges were as near as this to where they were expected is followed in one step."""
FOLLOW_REACHES_PX = (4.5, FINE_REACH_PX)
FOLLOWED_SHARE = 0.8
"""With fewer of its edges found a fit may have settled beside it, and wider steps are due."""
AGAIN_MIN = 0.95
SAME = 0.99
"""Correlation of two looks, one frame apart, that show the same thing; noise alone takes 0.002 to 0.03 of it."""
UNSETTLED = 0.03
"""Correlation that the judge may find and the alignment's last step did not; with less rivals need not be asked."""
MORE_STEPS = 3
STILL_MOVING_PX = 0.5
"""A last step that moved an edge further is followed by another."""
NEAR_MIN_PX = 24.0
RELIT_MIN_PX = 14.0
RELIT_ROUNDS = 2
"""The shadow's edge is found again on the map that it led to."""
SHADED_MIN_PX = 24.0
SHADED_REACHES_PX = (3.0, 2.5, FINE_REACH_PX)
IN_PLACES_MAX_PX = 110.0
"""Larger landmarks show all their edges, and these decide."""
RESOLVED = 0.75
"""A contour is measured by its edges if this part of its points has room."""
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


@dataclass(frozen=True, slots=True)
class Candidate:
    """What became of one hypothesis, for people to look at.

    Attributes:
        outlines_px: (k, 2) of each of its contours.
        code: As read, with "?" for what is neither triangle nor quadrangle.
        rejection: Why not; None if it was confirmed.
    """

    outlines_px: tuple[Array, ...]
    code: str
    rejection: Rejection | None


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


def confirm_large(rays_from_pad: Array, run: range, view: View, reach_px: tuple[float, ...]) -> Found | Rejection:
    """Fit the edges from a map that is nearly right for the contours `run`, and judge."""
    geometry = view.geometry
    fit = fit_edges(view.image, rays_from_pad, geometry, view.lens, run, reach_px, view.origin)
    everything = range(len(geometry.landmark.contours))
    for _ in range(MORE_STEPS):
        if fit is None or (fit.edges.step_px < STILL_MOVING_PX and fit.edges.share > NEARLY_ALL):
            break
        before = fit.edges.share
        reach_px = (max(NEXT_REACH_PX, REACH_PART * fit.edges.side_px), NEXT_REACH_PX, FINE_REACH_PX)
        fit = fit_edges(view.image, fit.rays_from_pad, geometry, view.lens, everything, reach_px, view.origin)
        if fit is not None and fit.edges.step_px < STILL_MOVING_PX and fit.edges.share <= before + 0.02:
            break
    if fit is None:
        return Rejection(Refusal.SIDES, "its sides don't hold the drawing")
    return judge_edges(fit, view)


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


def confirm_shaded(rays_from_pad: Array, view: View, led: bool = False) -> Found | Rejection:
    """A small landmark that a shadow or a cover crosses: fit the edges of its outer contours, and judge place by place;
    led as for judge_edges.

    The picture as a whole can't be aligned then.
    """
    run = range(min(2, len(view.geometry.landmark.contours)))
    fit = fit_edges(
        view.image, rays_from_pad, view.geometry, view.lens, run, SHADED_REACHES_PX, view.origin, alone=True
    )
    if fit is None:
        return Rejection(Refusal.SIDES, "its sides don't hold the drawing")
    return judge_edges(fit, view, led=led)


def follow_large(rays_from_pad: Array, view: View, before: Patch | None) -> Found | Rejection:
    """A large landmark where it is expected by the frame before, to a pixel or two; before is its look there."""
    geometry = view.geometry
    everything = range(len(geometry.landmark.contours))
    fit = fit_edges(
        view.image, rays_from_pad, geometry, view.lens, everything, FOLLOW_REACHES_PX, view.origin, easy_px=EASY_PX
    )
    return (
        Rejection(Refusal.SIDES, "its sides don't hold the drawing") if fit is None else judge_edges(fit, view, before)
    )


def confirm_small(
    rays_from_pad: Array, view: View, steps: int = STEPS, before: Patch | None = None
) -> Found | Rejection:
    """Align a small landmark's picture from a map that is nearly right, and judge.

    Args:
        rays_from_pad: The map.
        view: What to look at.
        steps: Of the alignment, at most.
        before: Its look when it was confirmed in the frame before: if it looks the same, that is enough.
    """
    aligned = align(view, rays_from_pad, steps)
    if aligned is None:
        return Rejection(Refusal.CORRELATION, "its picture doesn't hold the drawing")
    return judge_alignment(aligned, view, before)


def judge_alignment(aligned: Alignment, view: View, before: Patch | None = None) -> Found | Rejection:
    """An alignment, confirmed or refused; before as for confirm_small."""
    geometry, patch = view.geometry, aligned.patch
    size_px = side_px(patch)
    if size_px < SMALLEST_PX:
        return Rejection(Refusal.TOO_SMALL, f"side {size_px:.1f} px, under {SMALLEST_PX:.1f} px")
    score = aligned.correlation
    if score < WHOLE_MIN - UNSETTLED:
        return Rejection(Refusal.CORRELATION, f"correlation with the drawn landmark {score:.3f}, under {WHOLE_MIN:.3f}")
    same = before is not None and score > AGAIN_MIN and resemblance(before, patch) > SAME
    if not (same and aligned.contrast > MIN_CONTRAST):
        proof = check_picture(patch, geometry)
        score = proof.correlation
        if proof.rejection is not None:
            return proof.rejection
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


def confirm_relit(rays_from_pad: Array, view: View) -> Found | Rejection:
    """A landmark that a shadow's straight edge crosses: its picture is brought to one light, aligned and judged."""
    matrix = rays_from_pad
    found: Found | Rejection = Rejection(Refusal.CORRELATION, "no shadow's edge explains its picture")
    for _ in range(RELIT_ROUNDS):
        edge = find_shadow_edge(rectify(view, matrix), view.geometry)
        lit = None if edge is None else relit(view, matrix, edge)
        aligned = None if lit is None else align(lit, matrix)
        if lit is None or aligned is None:
            return found
        matrix = aligned.rays_from_pad
        found = judge_alignment(aligned, lit)
    return found


def _by_picture(maps: list[Array], view: View) -> list[tuple[Array, Patch, Explained]]:
    """Maps in the order in which the drawing explains what they see."""
    geometry = view.geometry
    found: list[tuple[Array, Patch, Explained]] = []
    for matrix in maps:
        patch = rectify(view, matrix)
        if not 1e-2 < patch.cell_px < 1e4:
            continue
        cells = geometry.cells(None)
        cells = cells if patch.whole else cells[patch.seen.ravel()[cells]]
        if len(cells) < 12:
            continue
        found.append((matrix, patch, explain_patch(patch, geometry, cells)))
    found.sort(key=lambda f: -f[2].correlation)
    return found


def reaches(patch: Patch) -> tuple[float, ...]:
    """How far from a rough map edges are sought, step by step."""
    first = max(FIRST_REACH_PX, REACH_PART * side_px(patch))
    return first, 0.5 * (first + NEXT_REACH_PX), NEXT_REACH_PX, FINE_REACH_PX


def confirm(maps: list[Array], run: range, view: View) -> Found | Rejection:
    """Confirm the best of some maps that differ in the heading.

    Args:
        maps: rays_from_pad, nearly right on the contours `run`.
        run: Contours that led to them.
        view: What to look at.
    """
    ordered = _by_picture(maps, view)
    if not ordered:
        return Rejection(Refusal.SHAPE, "too little of it lies in the image")
    nearest: Rejection | None = None
    outer = view.geometry.corners[view.geometry.slices[0]]
    for matrix, patch, _ in ordered[:2]:
        if view.tried.knows(project_pad(matrix, outer, view.lens)[0]):
            continue
        if side_px(patch) < SMALL_PX:
            found = confirm_small(matrix, view)
            if isinstance(found, Rejection) and side_px(patch) >= SHADED_MIN_PX:
                second = confirm_shaded(matrix, view)
                found = second if isinstance(second, Found) or second.test > found.test else found
        else:
            found = confirm_large(matrix, run, view, reaches(patch))
        if isinstance(found, Found):
            return found
        if nearest is None or found.test > nearest.test:
            nearest = found
    if nearest is not None:
        for matrix, patch, _ in ordered:
            if RELIT_MIN_PX <= side_px(patch) < SMALL_PX:
                found = confirm_relit(matrix, view)
                if isinstance(found, Found):
                    return found
                nearest = found if found.test > nearest.test else nearest
    return nearest or Rejection(Refusal.NO_NEST, "the same was refused before")


def confirm_partial(start: Array, contour: int, view: View) -> Found | Rejection:
    """Confirm a map that was made from one side of a contour, and is rough away from it.

    Args:
        start: rays_from_pad.
        contour: Whose side it is; which of its sides is open.
        view: What to look at.
    """
    geometry = view.geometry
    name = geometry.landmark.contours[contour].name
    alone = range(contour, contour + 1)
    fit = fit_edges(view.image, start, geometry, view.lens, alone, PARTIAL_REACHES_PX, view.origin, alone=True)
    if fit is None:
        return Rejection(Refusal.NOT_CONVEX, f"its sides don't hold {name}")
    seen, confirmed = int(fit.edges.in_view[contour]), int(fit.edges.confirmed[contour])
    if confirmed < max(PARTIAL_POINTS, PARTIAL_SHARE * seen):
        return Rejection(Refusal.NOT_CONVEX, f"{confirmed} of {seen} points on the sides of {name} are there")
    return confirm([fit.rays_from_pad @ turn for turn in geometry.turns_about(contour)], alone, view)


def _confirm_reading(nest: Nest, reading: Reading, view: View, min_side_px: float) -> Found | Rejection:
    """Test one reading of a nest."""
    geometry, lens = view.geometry, view.lens
    corners = [p.corners_px for p in nest.polygons[reading.start : reading.start + reading.length]]
    first, count = reading.first, reading.length
    outer = corners[0]
    sides_px = [math.dist(outer[i], outer[i - 1]) for i in range(len(outer))]
    if min(sides_px) < min_side_px:
        text = f"side of {geometry.landmark.contours[first].name} {min(sides_px):.1f} px, under {min_side_px:.1f} px"
        return Rejection(Refusal.TOO_SMALL, text)
    scale_px = sum(sides_px) / len(sides_px) / float(geometry.sides_m[first])
    fits = fit_run(corners, first, geometry, lens)
    if not fits:
        return Rejection(Refusal.SHAPE, "its corners don't span a plane")
    refused = check_rectified(fits[0], first, count, geometry, scale_px)
    if refused is not None:
        return refused
    return confirm([f.rays_from_pad for f in fits], range(first, first + count), view)


def examine(nest: Nest, view: View, min_side_px: float) -> tuple[Found | None, list[Candidate]]:
    """All that can be made of one nest: the first reading that is confirmed, and what became of those tried."""
    counts = tuple(p.corner_count for p in nest.polygons)
    code = "".join(str(c) if c else "?" for c in counts)
    outlines = tuple(p.corners_px for p in nest.polygons)
    candidates: list[Candidate] = []
    readings = alignments(counts, nest.outermost_black, view.geometry.landmark)
    for reading in readings:
        result = _confirm_reading(nest, reading, view, min_side_px)
        end = reading.start + reading.length
        refused = result if isinstance(result, Rejection) else None
        candidates.append(Candidate(outlines[reading.start : end], code[reading.start : end], refused))
        if isinstance(result, Found):
            return result, candidates
    if not readings:
        own = next((p.rejection for p in nest.polygons if p.rejection is not None), None)
        colour = "black" if nest.outermost_black else "white"
        text = f"code {code} ({colour} outermost) is not in the landmark's {view.geometry.landmark.code}"
        candidates.append(Candidate(outlines, code, own or Rejection(Refusal.CODE, text)))
    return None, candidates
