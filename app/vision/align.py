"""A small landmark fitted as a picture: the drawing, blurred as the camera blurs it, is moved until it explains the
grey of the rectified patch. Where contours are a pixel or two apart, edges blur into each other and only this is
unbiased.

What the light, the lens and the camera's tone curve do to the picture is fitted along with the move: the grey of black,
of white and of what lies round the quiet zone, a gradient of the light, more blur in any direction (focus, motion) and
a bend of the tone curve. What is left over then speaks against the drawing.

Method: inverse compositional Gauss-Newton with linear appearance (Baker and Matthews, "Lucas-Kanade 20 years on",
2004).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.geometry import LandmarkGeometry
from app.vision.patch import Patch, View, rectify, side_px
from app.vision.plane import warped
from app.vision.template import BLUR_SIGMA_PX2, GRADIENT_SIGMA, PATCH_EXTENT, PSF_SIGMA_PX, TONE_SIGMA

STEPS = 8
SMALL_STEP = 0.002
"""In half sides of the patch: with a smaller step the alignment has settled. Under blur a step leaves a third of
itself; at 20 px this is 0.03 px."""
PERSPECTIVE_WEIGHT = 0.05
"""Holds the two perspective terms near what they are unless the patch says otherwise, as a part of the information
that the patch has on its shift."""
NOISE_MIN_DN = 1.0
PLACE_SIGMA_PX = 0.01
"""What lens, sampling and tone leave open of the place of even the clearest picture, beside its noise."""
LEVELS = 9
_WHITE, _OUTSIDE, _UU, _VV, _UV, _TONE, _GU, _GV, _ONE = range(8, 8 + LEVELS)


@dataclass(frozen=True, slots=True)
class Alignment:
    """A map moved to where the patch agrees best with the drawing.

    Attributes:
        rays_from_pad: (3, 3).
        information: (8, 8), see app.messages.PlaneFit.
        patch: The patch there.
        model: (PATCH, PATCH) grey of the drawing with the fitted light, blur and tone.
        contrast: Grey levels from black to white.
        scatter_dn: Root mean square difference of patch and model on the landmark, grey levels.
        correlation: Of patch and model there.
        level: Grey half way from black to white.
        grey: (cells,) of the patch; where it is saturated and the model brighter, what the model says.
    """

    rays_from_pad: Array
    information: Array
    patch: Patch
    model: Array
    contrast: float
    scatter_dn: float
    correlation: float
    level: float
    grey: Array


def _priors(contrast: float, cell_px: float) -> Array:
    """(LEVELS,) 1 / sigma of what the appearance terms are expected to be, in grey levels; 0 where anything goes."""
    result = np.zeros(LEVELS)
    # Half the variance of the blur, in squared cells, times the second derivative.
    blur = 1.0 / (max(contrast, 1.0) * 0.5 * BLUR_SIGMA_PX2 / cell_px**2)
    result[[_UU - 8, _VV - 8]] = blur
    result[_UV - 8] = blur
    result[_TONE - 8] = 1.0 / (max(contrast, 1.0) * TONE_SIGMA)
    result[[_GU - 8, _GV - 8]] = 1.0 / (max(contrast, 1.0) * GRADIENT_SIGMA)
    return result


def _combination(levels: Array) -> Array:
    """(17, 25) how warp and appearance are made of Template.design, for these grey levels."""
    result = np.zeros((8 + LEVELS, 16 + LEVELS))
    result[_I8, _I8] = levels[0]
    result[_I8, 8 + _I8] = levels[1]
    result[8 + _I9, 16 + _I9] = 1.0
    return result


_I8, _I9 = np.arange(8), np.arange(LEVELS)


def align(view: View, rays_from_pad: Array, steps: int = STEPS) -> Alignment | None:
    """Move a map to where the patch agrees best with the drawing; None if the patch doesn't support it.

    Args:
        view: What to look at.
        rays_from_pad: (3, 3) where to begin, off by a part of the distance between contours.
        steps: At most so many.
    """
    geometry = view.geometry
    unit_m = 0.5 * PATCH_EXTENT * geometry.landmark.size_m
    matrix = rays_from_pad
    patch = rectify(view, matrix)
    if patch.leads_nowhere:
        return None
    template = geometry.template(math.hypot(PSF_SIGMA_PX, 0.3) / patch.cell_px)
    noise = 3.0
    levels = np.zeros(LEVELS)
    normal = np.zeros((8 + LEVELS, 8 + LEVELS))
    model: Array | None = None
    for step in range(steps + 1):
        counts = _counts(patch, model)
        if counts is None:
            weighted, gram = template.weighted_design, template.gram
        else:
            weighted = template.weighted_design * counts
            gram = weighted @ template.design.T
        side = weighted @ patch.grey.ravel()
        if step == 0:
            normal, side = gram[16:, 16:], side[16:]
        else:
            terms = _combination(levels)
            normal, side = terms @ gram @ terms.T, terms @ side
        held = normal.copy()
        if step > 0:
            hold = PERSPECTIVE_WEIGHT * 0.5 * (normal[2, 2] + normal[5, 5])
            held[6, 6] += hold
            held[7, 7] += hold
        # The weight of a prior counts the cells that make one pixel.
        prior = noise * _priors(levels[0] if step else 60.0, patch.cell_px) / min(1.0, patch.cell_px)
        size = len(held)
        # A drawing whose quiet zone fills the patch shows nothing outside.
        held.flat[(size - LEVELS) * (size + 1) :: size + 1] += prior * prior + 1e-6 * patch.grey.size
        try:
            solution = np.asarray(np.linalg.solve(held, side), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        levels = solution[-LEVELS:]
        if levels[0] < 1.0:
            return None
        if patch.clipped is not None:
            model = template.appearance @ levels
        if step == 0:
            continue
        d = solution[:8]
        largest = float(np.abs(d).max())
        if not largest < 0.5:
            return None
        matrix = matrix @ np.linalg.inv(_pad_warp(d, unit_m))
        patch = rectify(view, matrix)
        if patch.leads_nowhere:
            return None
        if largest < SMALL_STEP:
            break
    model = template.appearance @ levels
    return _finished(matrix, patch, model, levels, normal, geometry)


def _counts(patch: Patch, model: Array | None) -> Array | None:
    """(cells,) 1 where a cell counts, 0 where it lies outside the image or is saturated and the model as bright; None
    where all count.
    """
    if patch.clipped is None or model is None:
        return None if patch.whole else patch.seen.ravel().astype(np.float64)
    return np.asarray(patch.seen.ravel() & ~(patch.clipped & (model >= patch.grey.ravel())), dtype=np.float64)


def uncensored(grey: Array, clipped: NDArray[np.bool_] | None, model: Array) -> Array:
    """Grey levels, or the model's where those are saturated and it is brighter."""
    return grey if clipped is None else np.where(clipped, np.maximum(grey, model), grey)


def _pad_warp(d: Array, unit_m: float) -> Array:
    return warped(np.eye(3), d, unit_m)


def _placed(information: Array, sigma: float) -> Array:
    """(8, 8) information less what an error of both shifts, sigma each, takes from it (Woodbury's identity)."""
    shifts = information[:, _SHIFTS]
    result: Array = information - shifts @ np.linalg.solve(np.eye(2) / sigma**2 + shifts[_SHIFTS], shifts.T)
    return result


_SHIFTS = np.array([2, 5])


def _finished(
    matrix: Array, patch: Patch, model: Array, levels: Array, normal: Array, geometry: LandmarkGeometry
) -> Alignment:
    """The alignment with its information, all appearance terms eliminated."""
    contrast = float(levels[0])
    cells = geometry.cells(None)
    if not patch.whole:
        cells = cells[patch.seen.ravel()[cells]]
    whole = uncensored(patch.grey.ravel(), patch.clipped, model)
    grey = whole[cells]
    off = grey - model[cells]
    left = float(off @ off)
    scatter = math.sqrt(left / max(1, len(cells) - 12))
    spread = float(grey @ grey) - float(grey.sum()) ** 2 / max(1, len(cells))
    correlation = math.sqrt(max(0.0, 1.0 - left / spread)) if spread > 1e-6 else 0.0
    variance = max(scatter, NOISE_MIN_DN) ** 2 / min(1.0, patch.cell_px**2)
    appearance = normal[8:, 8:].copy()
    appearance.flat[:: LEVELS + 1] += (
        1e-6 * float(np.trace(appearance)) + variance * _priors(contrast, patch.cell_px) ** 2
    )
    information = (normal[:8, :8] - normal[:8, 8:] @ np.linalg.solve(appearance, normal[8:, :8])) / variance
    # From half sides of the patch to half sides of the landmark.
    scale = np.array([1.0, 1.0, 1.0 / PATCH_EXTENT, 1.0, 1.0, 1.0 / PATCH_EXTENT, PATCH_EXTENT, PATCH_EXTENT])
    information = _placed(information * scale * scale[:, None], PLACE_SIGMA_PX / (0.5 * side_px(patch)))
    level = float(levels[_ONE - 8]) + 0.5 * contrast
    return Alignment(
        matrix, information, patch, model.reshape(patch.grey.shape), contrast, scatter, correlation, level, whole
    )
