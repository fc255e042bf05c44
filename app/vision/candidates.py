"""From nested polygons to the landmark: each reading of a nest by Table I is tested, measured to sub-pixel and judged.

The stages are those of the paper (code, area ratios, relative position), with a fit of the drawn landmark between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from app.frames import Array
from app.vision.align import align
from app.vision.camera_model import Lens
from app.vision.contours import Nest
from app.vision.edges import Sides, measure_sides
from app.vision.evidence import (
    Judgement,
    Patch,
    check_final,
    check_heading,
    check_judgement,
    check_rectified,
    judge,
    rectify,
)
from app.vision.fit import Fit, apply, fit_corners, fit_run, project_pad
from app.vision.geometry import LandmarkGeometry
from app.vision.preprocess import Prepared
from app.vision.refusal import Refusal, Rejection
from app.vision.table import Alignment, alignments

SMALL_PX = 60.0
"""Landmarks with a smaller outer side are aligned as a picture, larger ones by their sides: between the paper's two
innermost contours there are 2.7 pixels at this size."""
COARSE_REACH_PX = 2.6
FINE_REACH_PX = 1.7
SAME_TURN = 0.05
"""Two fits that differ by a quarter turn up to this (radians, and metres on the pad) see the same patch, turned."""
MIN_SHARP = 0.5
"""Part of a run's corners whose sides must be measurable."""
MIN_GAP_SEEN_PX = 1.0
MIN_CORNERS = 6
"""So many measured corners are trusted without the binary image's."""
MIN_INNER_SEEN = 0.75
AGREES_PX = 1.5
"""A contour that the threshold missed counts as found if its measured corners lie this near to the fit."""
AGREES_PART = 0.02
"""And this part of its side in addition."""


@dataclass(frozen=True, slots=True)
class Found:
    """A confirmed landmark.

    Attributes:
        fit: Of the landmark in the frame.
        first: Index of the outermost contour found.
        corners_px: For each contour found, outermost first, (k, 2) in the landmark's order.
        judgement: Its evidence.
        scale_px: Pixels per metre on the pad.
    """

    fit: Fit
    first: int
    corners_px: tuple[Array, ...]
    judgement: Judgement
    scale_px: float

    def code(self, geometry: LandmarkGeometry) -> str:
        """Corner counts of the contours found."""
        return geometry.landmark.code[self.first : self.first + len(self.corners_px)]


@dataclass(frozen=True, slots=True)
class Candidate:
    """What became of one nest in one reading, for people to look at.

    Attributes:
        outlines_px: (k, 2) of each of its contours.
        code: As read, with "?" for what is neither triangle nor quadrangle.
        rejection: Why not; None if it was confirmed.
    """

    outlines_px: tuple[Array, ...]
    code: str
    rejection: Rejection | None


@dataclass(frozen=True, slots=True)
class Bench:
    """What every candidate of one region is tested with."""

    prepared: Prepared
    geometry: LandmarkGeometry
    lens: Lens
    min_side_px: float
    min_score: float
    sigma_px: float


def _extended(fit: Fit, run: range, sides: Sides, bench: Bench) -> tuple[range, Fit | None]:
    """The run grown by neighbours all of whose sides were measured where the fit puts them, and the fit on them all."""
    geometry, focal_px = bench.geometry, bench.lens.focal_px
    count = len(geometry.landmark.contours)
    predicted = apply(fit.basis @ fit.rays_from_pad, geometry.corners)
    off = sides.corners_plane - predicted
    edge = predicted[geometry.following] - predicted
    limit = AGREES_PX / focal_px + AGREES_PART * np.sqrt((edge * edge).sum(axis=1))
    with np.errstate(invalid="ignore"):
        agrees = sides.corner_found & ((off * off).sum(axis=1) < limit * limit)
    whole = np.logical_and.reduceat(agrees, [s.start for s in geometry.slices])
    low, high = run[0], run[-1] + 1
    while low > 0 and whole[low - 1]:
        low -= 1
    while high < count and whole[high]:
        high += 1
    indices = np.arange(geometry.slices[low].start, geometry.slices[high - 1].stop)
    measured = sides.corner_found[indices]
    if np.count_nonzero(measured) < MIN_CORNERS:
        plane = np.where(measured[:, None], sides.corners_plane[indices], predicted[indices])
        return range(low, high), fit_corners(plane, indices, fit.basis, geometry, focal_px)
    better = fit_corners(sides.corners_plane[indices[measured]], indices[measured], fit.basis, geometry, focal_px)
    if better is None:
        return range(low, high), None
    others = apply(better.basis @ better.rays_from_pad, geometry.corners[indices])
    plane = np.where(measured[:, None], sides.corners_plane[indices], others)
    return range(low, high), replace(better, indices=indices, plane=plane)


def _turn(a: Fit, b: Fit) -> tuple[int, bool]:
    """How many quarter turns clockwise b's heading is from a's, and whether that is a turn about the pad's origin."""
    turn = np.linalg.inv(a.rays_from_pad) @ b.rays_from_pad
    turn /= turn[2, 2]
    count = round(math.degrees(math.atan2(turn[1, 0], turn[0, 0])) / 90.0) % 4
    c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[count]
    return count, bool(np.abs(turn[:2] - np.array([[c, -s, 0.0], [s, c, 0.0]])).max() < SAME_TURN)


def _settle_heading(
    fits: list[Fit], innermost: int, scale_px: float, bench: Bench
) -> tuple[Fit, Judgement, Patch] | Rejection:
    """The fit whose heading the drawing supports, or why none. A small landmark is aligned on the way."""
    geometry, lens, prepared = bench.geometry, bench.lens, bench.prepared

    def look(fit: Fit, like: Fit | None = None, patch: Patch | None = None) -> tuple[Judgement, Fit, Patch]:
        """Judge a fit; its patch is that of another one turned, where that is all that differs."""
        count, pure = (0, False) if like is None else _turn(like, fit)
        if patch is not None and pure:
            patch = replace(
                patch,
                grey=np.rot90(patch.grey, count),
                seen=patch.seen if patch.seen.all() else np.rot90(patch.seen, count),
            )
        else:
            patch = rectify(prepared, fit, geometry, lens, scale_px, bench.sigma_px)
        return judge(patch, innermost, geometry), fit, patch

    first = look(fits[0])
    judged = sorted([first, *(look(fit, fits[0], first[2]) for fit in fits[1:])], key=lambda j: -j[0].score)
    if scale_px * geometry.size_m < SMALL_PX:
        before = judged[0][1]
        fit, patch = align(prepared, before, geometry, lens, scale_px, bench.sigma_px)
        moved = (judge(patch, innermost, geometry), fit, patch)
        if len(judged) > 1:
            # The next best heading, moved along.
            turn = np.linalg.inv(before.rays_from_pad) @ judged[1][1].rays_from_pad
            other = replace(judged[1][1], rays_from_pad=fit.rays_from_pad @ turn)
            judged = sorted([moved, look(other, fit, patch)], key=lambda j: -j[0].score)
        else:
            judged = [moved]
    best, fit, patch = judged[0]
    refused = check_judgement(best, bench.min_score)
    if refused is None and len(judged) > 1:
        count, _ = _turn(fit, judged[1][1])
        refused = check_heading(best, judged[1][0], patch, count, innermost, geometry)
    return refused if refused is not None else (fit, best, patch)


def confirm(nest: Nest, reading: Alignment, bench: Bench) -> Found | Rejection:
    """Test one reading of a nest."""
    geometry, lens = bench.geometry, bench.lens
    contours = geometry.landmark.contours
    corners = [p.corners_px for p in nest.polygons[reading.start : reading.start + reading.length]]
    first, count = reading.first, reading.length

    outer = corners[0]
    sides_px = [math.dist(outer[i], outer[i - 1]) for i in range(len(outer))]
    if min(sides_px) < bench.min_side_px:
        text = f"side of {contours[first].name} {min(sides_px):.1f} px, under {bench.min_side_px:.1f} px"
        return Rejection(Refusal.TOO_SMALL, text)
    scale_px = sum(sides_px) / len(sides_px) / float(geometry.sides_m[first])

    fits = fit_run(corners, first, geometry, lens)
    if not fits:
        return Rejection(Refusal.SHAPE, "its corners don't span a plane")
    refused = check_rectified(fits[0], first, count, geometry, scale_px)
    if refused is not None:
        return refused

    settled = _settle_heading(fits, first + count - 1, scale_px, bench)
    if isinstance(settled, Rejection):
        return settled
    fit, _, patch = settled
    run = range(first, first + count)
    if scale_px * geometry.size_m >= SMALL_PX:
        measured = _measured(fit, run, scale_px, bench)
        if isinstance(measured, Rejection):
            return measured
        fit, run = measured
        patch = rectify(bench.prepared, fit, geometry, lens, scale_px, bench.sigma_px)
    judgement = judge(patch, run[-1], geometry)
    refused = check_final(judgement, scale_px * geometry.size_m < SMALL_PX)
    if refused is not None:
        return refused
    innermost = _seen_inside(patch, run[-1], scale_px, geometry)
    run = range(run[0], innermost + 1)
    fit = _with_fitted(fit, run, geometry, keep=scale_px * geometry.size_m >= SMALL_PX)
    return _found(fit, run, judgement, scale_px, bench)


def _with_fitted(fit: Fit, run: range, geometry: LandmarkGeometry, keep: bool = True) -> Fit:
    """The fit with the corners of a run: those that it has, if they are kept, and the others where it puts them."""
    indices = np.arange(geometry.slices[run[0]].start, geometry.slices[run[-1]].stop)
    plane = apply(fit.basis @ fit.rays_from_pad, geometry.corners[indices])
    if keep:
        plane[fit.indices - indices[0]] = fit.plane
    return replace(fit, indices=indices, plane=plane)


def _seen_inside(patch: Patch, innermost: int, scale_px: float, geometry: LandmarkGeometry) -> int:
    """Index of the innermost contour of a small landmark that the picture shows, though the threshold may not have.

    A contour counts if it stands out from its neighbours by some pixels and what lies inside its parent agrees with
    the drawing.
    """
    while innermost + 1 < len(geometry.landmark.contours):
        gap_px = float(geometry.outer_gap_m[innermost + 1]) * scale_px
        inner = judge(patch, innermost, geometry).inner
        if gap_px < MIN_GAP_SEEN_PX or inner is None or inner < MIN_INNER_SEEN:
            break
        innermost += 1
    return innermost


def _measured(fit: Fit, run: range, scale_px: float, bench: Bench) -> tuple[Fit, range] | Rejection:
    """Measure the sides of all contours of the landmark that can be seen, now that its heading is known."""
    geometry, first = bench.geometry, run[0]
    final = _with_fitted(fit, run, geometry, keep=False)
    for reach_px in (COARSE_REACH_PX, FINE_REACH_PX):
        everything = range(len(geometry.landmark.contours))
        sides = measure_sides(
            bench.prepared, final.rays_from_pad, final.basis, geometry, bench.lens, everything, reach_px
        )
        share = float(sides.corner_found[final.indices].mean())
        if share < MIN_SHARP:
            text = f"{share * 100:.0f}% of its corners have sharp sides, under {MIN_SHARP * 100:.0f}%"
            return Rejection(Refusal.SIDES, text)
        run, better = _extended(final, run, sides, bench)
        if better is None:
            return Rejection(Refusal.SHAPE, "its corners don't span a plane")
        final = better
        # From inner contours alone an outer one was sought too far off: look again, if it is in view at all.
        if first == 0 or (run[0] == first and not _in_view(final, first - 1, bench)):
            break
    limit = AGREES_PX + AGREES_PART * float(geometry.sides_m[run[0]]) * scale_px
    if final.residual_px > limit:
        text = f"corners {final.residual_px:.1f} px off the drawn landmark, over {limit:.1f} px"
        return Rejection(Refusal.SHAPE, text)
    return final, run


def _in_view(fit: Fit, index: int, bench: Bench) -> bool:
    """Whether all corners of a contour lie in the region that is looked at."""
    px, seen = project_pad(fit.rays_from_pad, bench.geometry.corners[bench.geometry.slices[index]], bench.lens)
    u0, v0, u1, v1 = bench.prepared.region
    return bool(seen.all() and (px >= (u0, v0)).all() and (px <= (u1 - 1, v1 - 1)).all())


def _found(fit: Fit, run: range, judgement: Judgement, scale_px: float, bench: Bench) -> Found:
    """The result, its corners back in pixels."""
    rays = np.column_stack([fit.plane, np.ones(len(fit.plane))]) @ fit.basis
    px, _ = bench.lens.project(rays)
    slices, offset = bench.geometry.slices, int(fit.indices[0])
    corners = tuple(px[slices[k].start - offset : slices[k].stop - offset] for k in run)
    return Found(fit, run[0], corners, judgement, scale_px)


def examine(nest: Nest, bench: Bench) -> tuple[list[Found], list[Candidate]]:
    """All that can be made of one nest."""
    counts = tuple(p.corner_count for p in nest.polygons)
    code = "".join(str(c) if c else "?" for c in counts)
    outlines = tuple(p.corners_px for p in nest.polygons)
    found: list[Found] = []
    candidates: list[Candidate] = []
    readings = alignments(counts, nest.outermost_black, bench.geometry.landmark)
    for reading in readings:
        result = confirm(nest, reading, bench)
        end = reading.start + reading.length
        refused = result if isinstance(result, Rejection) else None
        candidates.append(Candidate(outlines[reading.start : end], code[reading.start : end], refused))
        if isinstance(result, Found):
            found.append(result)
            break
    if not readings:
        own = next((p.rejection for p in nest.polygons if p.rejection is not None), None)
        colour = "black" if nest.outermost_black else "white"
        text = f"code {code} ({colour} outermost) is not in the landmark's {bench.geometry.landmark.code}"
        candidates.append(Candidate(outlines, code, own or Rejection(Refusal.CODE, text)))
    return found, candidates
