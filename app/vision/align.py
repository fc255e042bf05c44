"""Sub-pixel alignment of a small landmark: the drawing, blurred as the camera blurs it, is moved until it explains the
grey of the rectified patch. Where contours are a pixel or two apart, edges blur into each other and only this is
unbiased.

Method: inverse compositional Gauss-Newton with gain and offset (Baker and Matthews, "Lucas-Kanade 20 years on", 2004).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.frames import Array
from app.vision.camera_model import Lens
from app.vision.evidence import Patch, rectify
from app.vision.fit import Fit
from app.vision.geometry import PATCH_EXTENT, LandmarkGeometry
from app.vision.preprocess import Prepared

STEPS = 5
LEVELS = 4
"""Grey levels that are fitted: white over black, the surroundings over black, more blur, black."""
SMALL_STEP = 0.012
"""In half sides of the patch: a smaller step leaves a tenth of itself, and the alignment has settled."""
SURROUND = 8.0
"""What lies round the quiet zone (grass) varies by this many times the noise on the landmark."""
PERSPECTIVE_WEIGHT = 0.05
"""Holds the two perspective terms near what they are unless the patch says otherwise, as a part of the information
that the patch has on its shift."""


def align(
    prepared: Prepared, fit: Fit, geometry: LandmarkGeometry, lens: Lens, scale_px: float, sigma_px: float
) -> tuple[Fit, Patch]:
    """A fit moved to where the patch agrees best with the drawing, and the patch there.

    The grey of black, of white and of what lies round the quiet zone are unknowns, and so is some more or less blur
    than expected. A fit that the patch doesn't support stays where it is.
    """
    half_m = 0.5 * PATCH_EXTENT * geometry.landmark.size_m
    scale, unscale = np.diag([half_m, half_m, 1.0]), np.diag([1.0 / half_m, 1.0 / half_m, 1.0])
    matrix = fit.rays_from_pad
    patch = rectify(prepared, fit, geometry, lens, scale_px, sigma_px)
    template = geometry.template(patch.sigma_cells)
    by_white, by_outside = template.slopes()
    rows = np.empty((by_white.shape[0], 8 + LEVELS))
    rows[:, 8:] = template.linear
    weight = 1.0 / (1.0 + (SURROUND * template.outside.reshape(-1, 1)) ** 2)
    hidden = np.flatnonzero(~patch.seen.ravel())
    levels: Array = np.zeros(LEVELS)
    for step in range(STEPS + 1):
        if len(hidden):
            weight[hidden] = 0.0
        grey = patch.grey.ravel()
        # First the grey levels alone; then they and the eight terms of the warp together.
        first = 8 if step == 0 else 0
        if step > 0:
            np.multiply(by_white, levels[0], out=rows[:, :8])
            rows[:, :8] += levels[1] * by_outside
        weighted = rows[:, first:] * weight
        normal = weighted.T @ rows[:, first:]
        if step > 0:
            hold = PERSPECTIVE_WEIGHT * 0.5 * (normal[2, 2] + normal[5, 5])
            normal[6, 6] += hold
            normal[7, 7] += hold
        try:
            solution = np.asarray(np.linalg.solve(normal, weighted.T @ grey), dtype=np.float64)
        except np.linalg.LinAlgError:
            break
        levels = solution[-LEVELS:]
        if levels[0] < 1.0:
            break
        if step == 0:
            continue
        d = solution[:8]
        largest = float(np.abs(d).max())
        if not largest < 0.5:
            break
        warp = np.array([[1.0 + d[0], d[1], d[2]], [d[3], 1.0 + d[4], d[5]], [d[6], d[7], 1.0]])
        matrix = matrix @ (scale @ np.linalg.inv(warp) @ unscale)
        patch = rectify(prepared, replace(fit, rays_from_pad=matrix), geometry, lens, scale_px, sigma_px)
        hidden = np.flatnonzero(~patch.seen.ravel())
        if largest < SMALL_STEP:
            break
    return replace(fit, rays_from_pad=matrix), patch
