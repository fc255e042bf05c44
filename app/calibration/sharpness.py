"""How blurred an image of a board is: the width of the edges between its squares. It knows nothing of lenses."""

from __future__ import annotations

import math

import cv2
import numpy as np

from app.frames import Array
from app.messages import Image

SAMPLES = 41
"""Along a profile across an edge."""
REACH = 0.35
"""Half length of a profile in squares: it ends well inside the squares on both sides."""
CENTRE = 0.12
"""Half length, in squares, of the part in which the edge itself is looked for: a marker in a white square is further
off than this."""
PLATEAU = 6
"""Samples at the dark end, whose mean is the black square's level."""
CONTRAST_MIN = 20.0
"""Grey levels between black and white, below which an edge says nothing."""


def edge_sigma_px(image: Image, grid: Array) -> float:
    """Blur of the edges between a board's squares as the sigma of a Gaussian, in the worse of the board's directions.

    An edge of contrast C that a Gaussian blurs rises by at most C / (sigma sqrt(2 pi)) a pixel. Half of C is the step
    from the edge's middle down to the black square's level: the white side may hold a marker.

    Args:
        image: (h, w) grey.
        grid: (rows, columns, 2) pixels of the board's inner corners; not a number where not known.

    Returns:
        Sigma in pixels, that of the pixels' own sampling included; 0 where no edge could be measured.
    """
    worst = 0.0
    for here, there in ((grid[:-1], grid[1:]), (grid[:, :-1], grid[:, 1:])):
        along = (there - here).reshape(-1, 2)
        known = np.isfinite(along).all(axis=1)
        sigmas = _sigmas(image, 0.5 * (here + there).reshape(-1, 2)[known], along[known])
        if len(sigmas):
            worst = max(worst, float(np.median(sigmas)))
    return worst


def _sigmas(image: Image, middle: Array, along: Array) -> Array:
    """(m,) sigma of each edge through `middle` in the direction `along`, which is a square long."""
    if not len(middle):
        return np.zeros(0)
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    steps = np.linspace(-REACH, REACH, SAMPLES)
    points = (middle[:, None, :] + steps[:, None] * normal[:, None, :]).astype(np.float32)
    profile = np.asarray(
        cv2.remap(image, points[..., 0], points[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        dtype=np.float64,
    )
    step_px = np.linalg.norm(along, axis=1) * (steps[1] - steps[0])
    rise = np.diff(profile, axis=1)[:, np.abs(0.5 * (steps[1:] + steps[:-1])) <= CENTRE]
    slope = rise[np.arange(len(rise)), np.abs(rise).argmax(axis=1)] / step_px
    black = np.where(slope > 0, profile[:, :PLATEAU].mean(axis=1), profile[:, -PLATEAU:].mean(axis=1))
    contrast = 2.0 * (profile[:, SAMPLES // 2] - black)
    clear = contrast > CONTRAST_MIN
    result: Array = contrast[clear] / np.maximum(np.abs(slope[clear]), 1e-6) / math.sqrt(2.0 * math.pi)
    return result
