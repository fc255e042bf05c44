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
from app.vision.geometry import PATCH, PATCH_EXTENT, LandmarkGeometry
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
MIN_CELLS = 40
"""A part of the patch with fewer cells is not correlated by itself."""
HEADING_MARGIN = 0.35
"""Of the difference that the drawing leads one to expect between a heading and the next best."""
PSF_SIGMA_PX = 0.75
"""Blur of a sharp lens and of the pixel's own area; the Gaussian of the first stage comes on top."""


def _polygon_area(corners: Array) -> float:
    x, y = corners.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def check_rectified(fit: Fit, first: int, count: int, geometry: LandmarkGeometry, scale_px: float) -> Rejection | None:
    """Area ratios and concentricity of a run, rectified by the fit; scale_px is pixels per metre on the pad.

    The limits widen where the corners are uncertain: an edge that is off by e all round changes the area of a square of
    side s by 4 e / s.
    """
    contours = geometry.landmark.contours
    inverse = np.asarray(np.linalg.inv(fit.basis @ fit.rays_from_pad), dtype=np.float64)
    flat = apply(inverse, fit.plane)
    start = 0
    rectified: list[Array] = []
    for k in range(first, first + count):
        n = contours[k].shape.corners
        rectified.append(flat[start : start + n])
        start += n
    for i, k in enumerate(range(first, first + count - 1)):
        outer, inner = contours[k], contours[k + 1]
        error_m = 0.5 * CORNER_ERROR_PX / scale_px
        slack = AREA_SLACK + error_m * (4.0 / outer.side_m + 4.0 / inner.side_m)
        ratio = _polygon_area(rectified[i]) / max(_polygon_area(rectified[i + 1]), 1e-12)
        drawn = geometry.landmark.area_ratio(k)
        if not drawn / slack <= ratio <= drawn * slack:
            limits = f"{drawn / slack:.2f}..{drawn * slack:.2f}"
            text = f"area ratio {outer.name}:{inner.name} {ratio:.2f} outside {limits}"
            return Rejection(Refusal.AREA_RATIO, text)
        shift = (rectified[i + 1].mean(0) - rectified[i].mean(0)) - (inner.centroid_m - outer.centroid_m)
        off_px, limit_px = float(np.hypot(*shift)) * scale_px, CORNER_ERROR_PX + 0.04 * outer.side_m * scale_px
        if off_px > limit_px:
            text = f"{inner.name} in {outer.name} is {off_px:.1f} px off its place, over {limit_px:.1f} px"
            return Rejection(Refusal.NOT_CONCENTRIC, text)
    limit = CORNER_ERROR_PX + SHAPE_PART * contours[first].side_m * scale_px
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
    px, valid = project_pad(fit.rays_from_pad, geometry.patch_points, lens)
    u0, v0, u1, v1 = prepared.region
    with np.errstate(invalid="ignore"):
        seen = valid & (px[:, 0] >= u0) & (px[:, 1] >= v0) & (px[:, 0] <= u1 - 1) & (px[:, 1] <= v1 - 1)
    at = (np.nan_to_num(px) - (u0, v0) + 0.5) / prepared.reduction - 0.5
    at32 = at.astype(np.float32).reshape(PATCH, PATCH, 2)
    grey = cv2.remap(prepared.smooth, at32[..., 0], at32[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    cell_px = PATCH_EXTENT * geometry.landmark.size_m * scale_px / PATCH
    sigma = math.hypot(PSF_SIGMA_PX, sigma_px if prepared.reduction == 1 else 0.4 * prepared.reduction)
    return Patch(grey.astype(np.float64), seen.reshape(PATCH, PATCH), sigma / cell_px)


def correlation(a: Array, b: Array) -> float:
    """Normalised correlation of two lists of values, -1..1; 0 where one is flat."""
    a, b = a - a.mean(), b - b.mean()
    power = float(a @ a) * float(b @ b)
    return float(a @ b) / math.sqrt(power) if power > 1e-9 else 0.0


@dataclass(frozen=True, slots=True)
class Judgement:
    """Evidence from the patch.

    Attributes:
        whole: Correlation of all that is seen.
        inner: Correlation inside the innermost contour found; None where nothing is drawn there or it is too small.
        contrast: Grey levels from black to white, by regression on the drawing.
        score: The two together, 0..1.
    """

    whole: float
    inner: float | None
    contrast: float
    score: float


def judge(patch: Patch, innermost: int, geometry: LandmarkGeometry) -> Judgement:
    """Correlate a patch with the drawing; innermost is the index of the innermost contour that was found."""
    drawing = geometry.template(patch.sigma_cells).white
    seen = patch.seen & geometry.judged
    if int(seen.sum()) < MIN_CELLS:
        return Judgement(0.0, None, 0.0, 0.0)
    whole = correlation(patch.grey[seen], drawing[seen])
    drawn = drawing[seen] - drawing[seen].mean()
    contrast = float(drawn @ patch.grey[seen]) / max(float(drawn @ drawn), 1e-9)
    inner: float | None = None
    if innermost < len(geometry.landmark.contours) - 1:
        cells = seen & geometry.inside(innermost)
        if int(cells.sum()) >= MIN_CELLS and float(np.ptp(drawing[cells])) > 0.1:
            inner = correlation(patch.grey[cells], drawing[cells])
    score = whole if inner is None else 0.5 * (whole + inner)
    return Judgement(whole, inner, contrast, max(0.0, min(1.0, score)))


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


def check_heading(
    best: Judgement, second: Judgement, patch: Patch, turn: int, innermost: int, geometry: LandmarkGeometry
) -> Rejection | None:
    """Whether the best heading stands out from another, `turn` quarter turns away, as the drawing says it should."""
    drawing = geometry.template(patch.sigma_cells).white
    cells = patch.seen & geometry.judged
    if innermost < len(geometry.landmark.contours) - 1 and best.inner is not None:
        cells = cells & geometry.inside(innermost)
    expected = 1.0 - correlation(np.rot90(drawing, turn)[cells], drawing[cells])
    mine = best.inner if best.inner is not None else best.whole
    other = second.inner if second.inner is not None else second.whole
    limit = HEADING_MARGIN * expected
    if mine - other < limit:
        text = f"heading open: correlation {mine:.2f} against {other:.2f} a turn away, closer than {limit:.2f}"
        return Rejection(Refusal.HEADING, text)
    return None
