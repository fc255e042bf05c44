"""From nested polygons to the landmark: each reading of a nest by Table I is tested, measured to sub-pixel and judged.

The stages are those of the paper (code, area ratios, relative position), with a fit of the drawn landmark between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from app.frames import Array
from app.vision.align import align
from app.vision.camera_model import Lens
from app.vision.contours import Nest
from app.vision.edges import Sides, measure_sides
from app.vision.evidence import Judgement, Patch, check_heading, check_judgement, check_rectified, judge, rectify
from app.vision.fit import Fit, apply, fit_corners, fit_run
from app.vision.geometry import LandmarkGeometry
from app.vision.preprocess import Prepared
from app.vision.refusal import Refusal, Rejection
from app.vision.table import Alignment, alignments

SMALL_PX = 46.0
"""Landmarks with a smaller outer side are aligned as a picture, larger ones by their sides: between the paper's two
innermost contours there are two pixels at this size."""
COARSE_REACH_PX = 2.6
FINE_REACH_PX = 1.7
MIN_SHARP = 0.5
"""Part of a run's corners whose sides must be measurable."""
MIN_GAP_SEEN_PX = 1.0
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


def _with_measured(fit: Fit, sides: Sides, bench: Bench) -> Fit | None:
    """The fit again, on the measured corners where there are some and on its own elsewhere."""
    plane = np.where(sides.corner_found[fit.indices, None], sides.corners_plane[fit.indices], fit.plane)
    return fit_corners(plane, fit.indices, fit.basis, bench.geometry, bench.lens.focal_px)


def _extended(fit: Fit, first: int, count: int, sides: Sides, bench: Bench) -> tuple[range, Fit | None]:
    """The run grown by neighbours all of whose sides were measured where the fit puts them, and the fit on them all."""
    geometry = bench.geometry
    contours = geometry.landmark.contours
    predicted = apply(fit.basis @ fit.rays_from_pad, geometry.corners)
    off_px = np.hypot(*(sides.corners_plane - predicted).T) * bench.lens.focal_px

    def agrees(k: int) -> bool:
        part = geometry.slices[k]
        side = float(np.linalg.norm(predicted[part.start + 1] - predicted[part.start])) * bench.lens.focal_px
        return bool(sides.corner_found[part].all() and (off_px[part] < AGREES_PX + AGREES_PART * side).all())

    low, high = first, first + count
    while low > 0 and agrees(low - 1):
        low -= 1
    while high < len(contours) and agrees(high):
        high += 1
    plane = np.full((len(geometry.corners), 2), np.nan)
    plane[fit.indices] = fit.plane
    plane = np.where(sides.corner_found[:, None], sides.corners_plane, plane)
    indices = np.arange(geometry.slices[low].start, geometry.slices[high - 1].stop)
    return range(low, high), fit_corners(plane[indices], indices, fit.basis, geometry, bench.lens.focal_px)


def _quarter_turns(a: Fit, b: Fit) -> int:
    """How many quarter turns clockwise b's heading is from a's."""
    turn = np.linalg.inv(a.rays_from_pad) @ b.rays_from_pad
    return round(float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))) / 90.0) % 4


def _settle_heading(
    fits: list[Fit], innermost: int, scale_px: float, bench: Bench
) -> tuple[Fit, Judgement, Patch] | Rejection:
    """The fit whose heading the drawing supports, or why none."""
    geometry, lens = bench.geometry, bench.lens
    judged: list[tuple[Judgement, Fit, Patch]] = []
    for fit in fits:
        patch = rectify(bench.prepared, fit, geometry, lens, scale_px, bench.sigma_px)
        judged.append((judge(patch, innermost, geometry), fit, patch))
    judged.sort(key=lambda j: -j[0].score)
    if scale_px * geometry.landmark.size_m < SMALL_PX:
        moved = [align(bench.prepared, fit, geometry, lens, scale_px, bench.sigma_px) for _, fit, _ in judged[:2]]
        judged = [(judge(patch, innermost, geometry), fit, patch) for fit, patch in moved]
        judged.sort(key=lambda j: -j[0].score)
    best, fit, patch = judged[0]
    refused = check_judgement(best, bench.min_score)
    if refused is None and len(judged) > 1:
        second, other, _ = judged[1]
        refused = check_heading(best, second, patch, _quarter_turns(fit, other), innermost, geometry)
    return refused if refused is not None else (fit, best, patch)


def confirm(nest: Nest, reading: Alignment, bench: Bench) -> Found | Rejection:
    """Test one reading of a nest."""
    geometry, lens = bench.geometry, bench.lens
    contours = geometry.landmark.contours
    corners = [p.corners_px for p in nest.polygons[reading.start : reading.start + reading.length]]
    first, count = reading.first, reading.length

    sides_px = np.linalg.norm(corners[0] - np.roll(corners[0], 1, axis=0), axis=1)
    if sides_px.min() < bench.min_side_px:
        text = f"side of {contours[first].name} {sides_px.min():.1f} px, under {bench.min_side_px:.1f} px"
        return Rejection(Refusal.TOO_SMALL, text)
    scale_px = float(sides_px.mean()) / contours[first].side_m

    fits = fit_run(corners, first, geometry, lens)
    if not fits:
        return Rejection(Refusal.SHAPE, "its corners don't span a plane")
    refused = check_rectified(fits[0], first, count, geometry, scale_px)
    if refused is not None:
        return refused

    small = scale_px * geometry.landmark.size_m < SMALL_PX
    measured = fits if small else _sharpened(fits, first, count, bench)
    if isinstance(measured, Rejection):
        return measured
    settled = _settle_heading(measured, first + count - 1, scale_px, bench)
    if isinstance(settled, Rejection):
        return settled
    fit, judgement, patch = settled
    if small:
        run = range(first, _seen_inside(patch, first + count - 1, scale_px, geometry) + 1)
        indices = np.arange(geometry.slices[run[0]].start, geometry.slices[run[-1]].stop)
        plane = apply(fit.basis @ fit.rays_from_pad, geometry.corners[indices])
        return _found(replace(fit, indices=indices, plane=plane), run, judgement, scale_px, bench)
    own = replace(fit, plane=apply(fit.basis @ fit.rays_from_pad, geometry.corners[fit.indices]))
    return _measured(own, judgement, first, count, scale_px, bench)


def _seen_inside(patch: Patch, innermost: int, scale_px: float, geometry: LandmarkGeometry) -> int:
    """Index of the innermost contour of a small landmark that the picture shows, though the threshold may not have.

    A contour counts if it stands out from its neighbours by some pixels and what lies inside its parent agrees with
    the drawing.
    """
    while innermost + 1 < len(geometry.landmark.contours):
        gap_px = float(geometry.gap_m[geometry.slices[innermost + 1].start]) * scale_px
        inner = judge(patch, innermost, geometry).inner
        if gap_px < MIN_GAP_SEEN_PX or inner is None or inner < MIN_INNER_SEEN:
            break
        innermost += 1
    return innermost


def _sharpened(fits: list[Fit], first: int, count: int, bench: Bench) -> list[Fit] | Rejection:
    """Fits (the same contours, other headings) on measured sides instead of the binary image's corners."""
    geometry, lens = bench.geometry, bench.lens
    run = range(first, first + count)
    sides = measure_sides(bench.prepared, fits[0].rays_from_pad, fits[0].basis, geometry, lens, run, COARSE_REACH_PX)
    part = slice(geometry.slices[first].start, geometry.slices[first + count - 1].stop)
    share = float(sides.corner_found[part].mean())
    if share < MIN_SHARP:
        text = f"{share * 100:.0f}% of its corners have sharp sides, under {MIN_SHARP * 100:.0f}%"
        return Rejection(Refusal.SIDES, text)
    better = _with_measured(fits[0], sides, bench)
    if better is None:
        return Rejection(Refusal.SHAPE, "its corners don't span a plane")
    undo = np.linalg.inv(fits[0].rays_from_pad)
    return [replace(better, rays_from_pad=better.rays_from_pad @ (undo @ fit.rays_from_pad)) for fit in fits]


def _measured(
    fit: Fit, judgement: Judgement, first: int, count: int, scale_px: float, bench: Bench
) -> Found | Rejection:
    """Measure all contours of the landmark that can be seen, now that its place and heading are known."""
    geometry = bench.geometry
    everything = range(len(geometry.landmark.contours))
    sides = measure_sides(bench.prepared, fit.rays_from_pad, fit.basis, geometry, bench.lens, everything, FINE_REACH_PX)
    run, final = _extended(fit, first, count, sides, bench)
    if final is None:
        return Rejection(Refusal.SHAPE, "its corners don't span a plane")
    limit = AGREES_PX + AGREES_PART * geometry.landmark.contours[run[0]].side_m * scale_px
    if final.residual_px > limit:
        text = f"corners {final.residual_px:.1f} px off the drawn landmark, over {limit:.1f} px"
        return Rejection(Refusal.SHAPE, text)
    return _found(final, run, judgement, scale_px, bench)


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
