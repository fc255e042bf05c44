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
    linear, (by_white, by_outside) = template.linear, template.slopes()
    weight = 1.0 / (1.0 + (SURROUND * template.outside.ravel()) ** 2)
    levels: Array = np.zeros(0)
    for _ in range(STEPS):
        seen = patch.seen.ravel()
        grey = patch.grey.ravel()
        if not len(levels):
            levels = np.asarray(np.linalg.lstsq(linear[seen], grey[seen], rcond=None)[0], dtype=np.float64)
        if levels[0] < 1.0:
            break
        rows = np.column_stack([levels[0] * by_white + levels[1] * by_outside, linear])[seen]
        weighted = rows * weight[seen, None]
        normal = weighted.T @ rows
        hold = PERSPECTIVE_WEIGHT * 0.5 * (normal[2, 2] + normal[5, 5])
        normal[6, 6] += hold
        normal[7, 7] += hold
        try:
            solution = np.linalg.solve(normal, weighted.T @ grey[seen])
        except np.linalg.LinAlgError:
            break
        d, levels = solution[:8], solution[8:]
        if not np.abs(d).max() < 0.5:
            break
        warp = np.array([[1.0 + d[0], d[1], d[2]], [d[3], 1.0 + d[4], d[5]], [d[6], d[7], 1.0]])
        matrix = matrix @ (scale @ np.linalg.inv(warp) @ unscale)
        patch = rectify(prepared, replace(fit, rays_from_pad=matrix), geometry, lens, scale_px, sigma_px)
        if np.abs(d).max() < SMALL_STEP:
            break
    return replace(fit, rays_from_pad=matrix), patch
