"""From hypotheses to the landmark: maps of the pad's plane that may be right are measured to sub-pixel, and judged.

A hypothesis comes from nested polygons (the paper's way, read by Table I), from the frame before, or from the other
finders; what confirms it is the same for all. Small landmarks are fitted as a picture, larger ones by their edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from app.frames import Array
from app.vision.align import STEPS, Alignment, align
from app.vision.contours import Nest
from app.vision.evidence import check_rectified
from app.vision.fit import fit_run, project_pad
from app.vision.patch import Patch, View, rectify, side_px
from app.vision.picture import Explained, explain_patch
from app.vision.refine import FINE_REACH_PX, NEARLY_ALL, fit_edges
from app.vision.refusal import Refusal, Rejection
from app.vision.relight import find_shadow_edge, relit
from app.vision.ring import Ring
from app.vision.table import Alignment as Reading
from app.vision.table import alignments
from app.vision.verdict import SMALL_PX, Found, judge_alignment, judge_edges

ALIKE_MIN = 0.5
"""Correlation with the drawing in one light that a map must have before it is measured, but for a shadow's edge. Of
rendered landmarks, covered, shaded and cut ones too, the right maps have 0.56 and more, unless the shade is very deep;
of those made from single sides of other things most have less."""
FIRST_REACH_PX = 4.0
NEXT_REACH_PX = 3.0
REACH_PART = 0.012
"""Where sides are still missing they are sought this part of the outer side away, nearer in steps."""
PARTIAL_REACHES_PX = (12.0, 6.0)
RING_REACHES_PX = (12.0, 8.0, 5.0, FINE_REACH_PX)
PARTIAL_POINTS = 12
PARTIAL_SHARE = 0.6
EASY_PX = 0.6
"""A fine look at a followed landmark that moved no edge further is the last: a tenth of that is left."""
FOLLOW_REACHES_PX = (4.5, FINE_REACH_PX, FINE_REACH_PX)
FOLLOWED_SHARE = 0.8
"""With fewer of its edges found a fit may have settled beside it, and wider steps are due."""
MORE_STEPS = 3
STILL_MOVING_PX = 0.5
"""A last step that moved an edge further is followed by another."""
UNSETTLED_PX, UNSETTLED_PART = 0.8, 0.0015
"""A fit whose last step still moved an edge so far, and by this part of the outer side, goes to and fro between two
wrong answers. Of right ones that are smaller than the image none moves by more than 0.43 pixels; with a lens that is
not quite as its file says, large ones swing by a thousandth of their side."""
RELIT_MIN_PX = 14.0
RELIT_ROUNDS = 2
"""The shadow's edge is found again on the map that it led to."""
SHADED_MIN_PX = 24.0
SHADED_REACHES_PX = (3.0, 2.5, FINE_REACH_PX)


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
    moved_px = fit.edges.step_px
    if moved_px > max(UNSETTLED_PX, UNSETTLED_PART * fit.edges.side_px):
        return Rejection(Refusal.SIDES, f"its sides don't settle: the last step moved them by {moved_px:.1f} px")
    return judge_edges(fit, view)


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


def confirm_relit(rays_from_pad: Array, view: View) -> Found | Rejection:
    """A landmark that a shadow's straight edge crosses: its picture is brought to one light, aligned and judged."""
    matrix = rays_from_pad
    last: tuple[Alignment, View] | None = None
    for _ in range(RELIT_ROUNDS):
        edge = find_shadow_edge(rectify(view, matrix), view.geometry)
        lit = None if edge is None else relit(view, matrix, edge)
        aligned = None if lit is None else align(lit, matrix)
        if lit is None or aligned is None:
            break
        matrix, last = aligned.rays_from_pad, (aligned, lit)
    if last is None:
        return Rejection(Refusal.CORRELATION, "no shadow's edge explains its picture")
    return judge_alignment(*last)


def _by_picture(maps: list[Array], view: View) -> list[tuple[Array, Patch, Explained]]:
    """Maps in the order in which the drawing explains what they see."""
    geometry = view.geometry
    found: list[tuple[Array, Patch, Explained]] = []
    for matrix in maps:
        patch = rectify(view, matrix)
        if patch.leads_nowhere:
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
    best = ordered[0][2].correlation
    if best < ALIKE_MIN:
        text = f"correlation with the drawn landmark {best:.2f}, under {ALIKE_MIN:.2f}"
        nearest = Rejection(Refusal.CORRELATION, text)
    outer = view.geometry.corners[view.geometry.slices[0]]
    for matrix, patch, _ in ordered[:2] if nearest is None else ():
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


def confirm_ring(ring: Ring, view: View) -> Found | Rejection:
    """Confirm a map that was made from a corner of the ring between two contours, and is rough away from it."""
    geometry = view.geometry
    run = range(ring.contour, ring.contour + 2)
    fit = fit_edges(view.image, ring.rays_from_pad, geometry, view.lens, run, RING_REACHES_PX, view.origin, alone=True)
    if fit is None:
        return Rejection(Refusal.NOT_CONVEX, "its sides don't hold the ring")
    if fit.edges.share < PARTIAL_SHARE or int(fit.edges.confirmed.sum()) < PARTIAL_POINTS:
        return Rejection(Refusal.NOT_CONVEX, f"{fit.edges.share * 100:.0f}% of the ring's sides are there")
    return confirm([fit.rays_from_pad @ turn for turn in geometry.turns_about(ring.contour)], run, view)


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
