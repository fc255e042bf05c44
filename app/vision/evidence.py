"""What speaks for a candidate: area ratios, concentricity and shape after rectification, contrast, and the correlation
of the rectified patch with the drawn landmark, which settles the heading too. Each test returns its refusal or None.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.camera_model import Lens
from app.vision.fit import Fit, apply, project_pad
from app.vision.geometry import NODES, PATCH, PATCH_EXTENT, LandmarkGeometry
from app.vision.preprocess import Prepared
from app.vision.refusal import Refusal, Rejection

CORNER_ERROR_PX = 1.6
"""Corners of a binary image lie this far from the true ones at most, before they are refined."""
SHAPE_PART = 0.035
"""And this part of the outermost side in addition: bent prints, lens errors."""
AREA_SLACK = 1.22
"""Area ratios may differ by this factor beside what CORNER_ERROR_PX does."""
MIN_CONTRAST = 14.0
"""Grey levels between the landmark's black and its white."""
MIN_INNER = 0.5
"""Smallest correlation of the part inside the innermost contour that was found, where something is drawn there."""
FINAL_WHOLE = 0.75
FINAL_INNER = 0.88
FINAL_INNER_SMALL = 0.9
UNEXPLAINED = 0.054
"""Rendered landmarks of 14 px and more, under noise of 8 grey levels in a contrast of 65, reach 0.95 and 0.053; those
with one triangle upside down, or without the innermost square, 0.95 and 0.055 at best, most of them 0.9 and 0.09."""
MIN_CELLS = 40
"""A part of the patch with fewer cells is not correlated by itself."""
FLAT = 0.002
"""Variance (black 0, white 1) under which a part of the blurred drawing holds nothing to correlate with."""
HEADING_MARGIN = 0.35
"""Of the difference that the drawing leads one to expect between a heading and the next best."""
_ALL_SEEN: NDArray[np.bool_] = np.ones((PATCH, PATCH), dtype=np.bool_)
PSF_SIGMA_PX = 0.75
"""Blur of a sharp lens and of the pixel's own area; the Gaussian of the first stage comes on top."""


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


@dataclass(frozen=True, slots=True)
class Patch:
    """The rectified landmark.

    Attributes:
        grey: (PATCH, PATCH) sampled through the fit, front row first.
        seen: (PATCH, PATCH) whether the cell lies in the image.
        sigma_cells: Blur to expect, in cells.
    """

    grey: Array
    seen: NDArray[np.bool_]
    sigma_cells: float


def rectify(
    prepared: Prepared, fit: Fit, geometry: LandmarkGeometry, lens: Lens, scale_px: float, sigma_px: float
) -> Patch:
    """Sample the patch of a fit; sigma_px is the Gaussian of the first stage."""
    nodes, _ = project_pad(fit.rays_from_pad, geometry.patch_nodes, lens)
    nodes = (nodes - prepared.region[:2] + 0.5) / prepared.reduction - 0.5
    spread = geometry.between_nodes
    u = (spread @ nodes[:, 0].reshape(NODES, NODES) @ spread.T).astype(np.float32)
    v = (spread @ nodes[:, 1].reshape(NODES, NODES) @ spread.T).astype(np.float32)
    height, width = prepared.smooth.shape
    low_u, low_v = nodes.min(axis=0)
    high_u, high_v = nodes.max(axis=0)
    if low_u >= 0 and low_v >= 0 and high_u <= width - 1 and high_v <= height - 1:
        seen = _ALL_SEEN
    else:
        with np.errstate(invalid="ignore"):
            seen = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
        u, v = np.where(seen, u, 0.0).astype(np.float32), np.where(seen, v, 0.0).astype(np.float32)
    grey = cv2.remap(prepared.smooth, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    cell_px = PATCH_EXTENT * geometry.size_m * scale_px / PATCH
    sigma = math.hypot(PSF_SIGMA_PX, sigma_px if prepared.reduction == 1 else 0.4 * prepared.reduction)
    return Patch(grey.astype(np.float64), seen, sigma / cell_px)


def _moments(a: Array, b: Array) -> tuple[float, float, float]:
    """Variances of two lists of n values, and their covariance, each times n."""
    n = len(a)
    mean_a, mean_b = float(a.sum()) / n, float(b.sum()) / n
    return (
        float(a @ a) - n * mean_a * mean_a,
        float(b @ b) - n * mean_b * mean_b,
        float(a @ b) - n * mean_a * mean_b,
    )


def correlation(a: Array, b: Array) -> float:
    """Normalised correlation of two lists of values, -1..1; 0 where one is flat."""
    aa, bb, ab = _moments(a, b)
    return ab / math.sqrt(aa * bb) if aa > 1e-9 and bb > 1e-9 else 0.0


@dataclass(frozen=True, slots=True)
class Judgement:
    """Evidence from the patch.

    Attributes:
        whole: Correlation of all that is seen.
        inner: Correlation inside the innermost contour found; None where nothing is drawn there or it is too small.
        contrast: Grey levels from black to white, by regression on the drawing.
        score: The two together, 0..1.
        unexplained: What differs from the drawing inside the innermost contour found, root mean square, as a part of
            the contrast; 0 where inner is None.
    """

    whole: float
    inner: float | None
    contrast: float
    score: float
    unexplained: float = 0.0


def _seen_cells(patch: Patch, geometry: LandmarkGeometry, inside_of: int | None) -> NDArray[np.intp]:
    """Flat indices of the judged cells (of those inside a contour) that lie in the image."""
    cells = geometry.cells(inside_of)
    return cells if patch.seen is _ALL_SEEN else cells[patch.seen.ravel()[cells]]


def judge(patch: Patch, innermost: int, geometry: LandmarkGeometry) -> Judgement:
    """Correlate a patch with the drawing; innermost is the index of the innermost contour that was found."""
    drawing, grey = geometry.template(patch.sigma_cells).white.ravel(), patch.grey.ravel()
    seen = _seen_cells(patch, geometry, None)
    if len(seen) < MIN_CELLS:
        return Judgement(0.0, None, 0.0, 0.0)
    gg, dd, gd = _moments(grey[seen], drawing[seen])
    whole = gd / math.sqrt(gg * dd) if gg > 1e-9 and dd > 1e-9 else 0.0
    contrast = gd / max(dd, 1e-9)
    inner: float | None = None
    unexplained = 0.0
    if innermost < len(geometry.landmark.contours) - 1:
        cells = _seen_cells(patch, geometry, innermost)
        if len(cells) >= MIN_CELLS:
            gg, dd, gd = _moments(grey[cells], drawing[cells])
            if dd > FLAT * len(cells):
                inner = gd / math.sqrt(gg * dd) if gg > 1e-9 else 0.0
                unexplained = math.sqrt(max(gg - gd * gd / dd, 0.0) / len(cells)) / max(contrast, 1.0)
    score = whole if inner is None else 0.5 * (whole + inner)
    return Judgement(whole, inner, contrast, max(0.0, min(1.0, score)), unexplained)


def check_judgement(judgement: Judgement, min_score: float) -> Rejection | None:
    """Contrast and correlations against their limits."""
    if judgement.contrast < MIN_CONTRAST:
        text = f"contrast {judgement.contrast:.0f} grey levels, under {MIN_CONTRAST:.0f}"
        return Rejection(Refusal.CONTRAST, text)
    if judgement.whole < min_score:
        text = f"correlation with the drawn landmark {judgement.whole:.2f}, under {min_score:.2f}"
        return Rejection(Refusal.CORRELATION, text)
    if judgement.inner is not None and judgement.inner < MIN_INNER:
        text = f"correlation inside the contours found {judgement.inner:.2f}, under {MIN_INNER:.2f}"
        return Rejection(Refusal.INNER_CORRELATION, text)
    return None


def check_final(judgement: Judgement, small: bool) -> Rejection | None:
    """The stricter limits that hold once the landmark is measured, or aligned (`small`)."""
    if judgement.whole < FINAL_WHOLE:
        text = f"correlation with the drawn landmark {judgement.whole:.2f}, under {FINAL_WHOLE:.2f}"
        return Rejection(Refusal.CORRELATION, text)
    if judgement.inner is None:
        return None
    limit = FINAL_INNER_SMALL if small else FINAL_INNER
    if judgement.inner < limit:
        text = f"correlation inside the contours found {judgement.inner:.2f}, under {limit:.2f}"
        return Rejection(Refusal.INNER_CORRELATION, text)
    if small and judgement.unexplained > UNEXPLAINED:
        text = (
            f"{judgement.unexplained * 100:.1f}% of the contrast inside the contours found is not as drawn, "
            f"over {UNEXPLAINED * 100:.1f}%"
        )
        return Rejection(Refusal.INNER_CORRELATION, text)
    return None


def check_heading(
    best: Judgement, second: Judgement, patch: Patch, turn: int, innermost: int, geometry: LandmarkGeometry
) -> Rejection | None:
    """Whether the best heading stands out from another, `turn` quarter turns away, as the drawing says it should."""
    drawing = geometry.template(patch.sigma_cells).white
    cells = _seen_cells(patch, geometry, innermost if best.inner is not None else None)
    expected = 1.0 - correlation(np.rot90(drawing, turn).ravel()[cells], drawing.ravel()[cells])
    mine = best.inner if best.inner is not None else best.whole
    other = second.inner if second.inner is not None else second.whole
    limit = HEADING_MARGIN * expected
    if mine - other < limit:
        text = f"heading open: correlation {mine:.2f} against {other:.2f} a turn away, closer than {limit:.2f}"
        return Rejection(Refusal.HEADING, text)
    return None
