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
from app.vision.geometry import PATCH, PATCH_EXTENT, LandmarkGeometry
from app.vision.preprocess import Prepared

STEPS = 5
SMALL_STEP = 0.004
"""In half sides of the patch: the alignment has settled."""
PERSPECTIVE_WEIGHT = 0.05
"""Holds the two perspective terms near what they are unless the patch says otherwise, as a part of the information
that the patch has on its shift."""


def _columns(geometry: LandmarkGeometry, patch: Patch) -> Array:
    """(PATCH^2, 10) derivatives of the drawing with respect to eight homography terms, then itself and one."""
    drawing = geometry.template(patch.sigma_cells)
    half = PATCH / 2.0
    # Row 0 is the front: forward falls as the row rises, right rises with the column.
    by_row, by_column = np.gradient(drawing)
    along, across = (-by_row * half).ravel(), (by_column * half).ravel()
    x, y = (geometry.patch_points / (0.5 * PATCH_EXTENT * geometry.landmark.size_m)).T
    radial = along * x + across * y
    return np.column_stack(
        [
            along * x,
            along * y,
            along,
            across * x,
            across * y,
            across,
            -radial * x,
            -radial * y,
            drawing.ravel(),
            np.ones(len(x)),
        ]
    )


def align(
    prepared: Prepared, fit: Fit, geometry: LandmarkGeometry, lens: Lens, scale_px: float, sigma_px: float
) -> tuple[Fit, Patch]:
    """A fit moved to where the patch agrees best with the drawing, and the patch there.

    A fit that the patch doesn't support stays where it is.
    """
    half_m = 0.5 * PATCH_EXTENT * geometry.landmark.size_m
    scale = np.diag([half_m, half_m, 1.0])
    unscale = np.diag([1.0 / half_m, 1.0 / half_m, 1.0])
    matrix = fit.rays_from_pad
    patch = rectify(prepared, fit, geometry, lens, scale_px, sigma_px)
    columns = _columns(geometry, patch)
    for _ in range(STEPS):
        seen = patch.seen.ravel()
        a = columns if seen.all() else columns[seen]
        normal = a.T @ a
        hold = PERSPECTIVE_WEIGHT * 0.5 * (normal[2, 2] + normal[5, 5])
        normal[6, 6] += hold
        normal[7, 7] += hold
        try:
            solution = np.linalg.solve(normal, a.T @ patch.grey.ravel()[seen])
        except np.linalg.LinAlgError:
            break
        gain = float(solution[8])
        if gain < 1.0:
            break
        d = solution[:8] / gain
        if not np.abs(d).max() < 0.5:
            break
        warp = np.array([[1.0 + d[0], d[1], d[2]], [d[3], 1.0 + d[4], d[5]], [d[6], d[7], 1.0]])
        matrix = matrix @ (scale @ np.linalg.inv(warp) @ unscale)
        patch = rectify(prepared, replace(fit, rays_from_pad=matrix), geometry, lens, scale_px, sigma_px)
        if np.abs(d).max() < SMALL_STEP:
            break
    return replace(fit, rays_from_pad=matrix), patch
