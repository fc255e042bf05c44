"""Where a patch agrees with the drawing under a light that differs from place to place: what shadows, glare and covers
leave of the proof.

The grey that black and white have near a cell is the median of the cells round it that are drawn so: medians keep to
one side of a shadow's edge, and what little is covered or drawn otherwise doesn't move them. With these levels a cell
agrees with a drawing or it doesn't, or it is mute (saturated). The landmark must agree in most cells; and of those
where it differs from a rival (turned, a part upside down, missing, larger, of another shape) it must agree in a good
part, and clearly more often than the rival does.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from app.frames import Array
from app.vision.geometry import LandmarkGeometry
from app.vision.patch import Patch
from app.vision.picture import Proof
from app.vision.refusal import Refusal, Rejection
from app.vision.template import PATCH, PSF_SIGMA_PX

HALF, STRIDE = 4, 2
"""Cells to each side whose levels are asked, every second one."""
DRAWN_BLACK, DRAWN_WHITE = 0.15, 0.85
FEWEST_LEVELS = 3
SPREADS = (2.0, 5.0, 12.0)
"""Where no such cell is near, levels come from so many cells away (standard deviation of the weights)."""
MIN_CONTRAST_DN = 8.0
FAINT = 0.25
"""Contrast, as a part of the usual one, that counts: in the deepest shadow it is less."""
MUTE_DN = 250.0
"""What is brighter on average is saturated."""
LIKE = 0.22
"""A cell agrees if its grey is this near to the drawing's, as a part of the contrast there."""
AVERAGED = 3
"""Cells along the square that is compared."""
TELLS = 0.35
"""Two drawings that differ by more, black 0 and white 1, can be told apart."""
FEWEST = 16
ODDS = 2.5
"""The drawing must agree in so many times the cells where a rival agrees and it doesn't."""
PART = 0.3
"""And in this part of all cells that would tell the two apart."""


@dataclass(frozen=True, slots=True)
class Levels:
    """Grey of black and white, cell by cell; not a number where nothing tells.

    Attributes:
        black: (PATCH, PATCH).
        white: (PATCH, PATCH).
    """

    black: Array
    white: Array


def _medians(grey: Array, where: NDArray[np.bool_]) -> Array:
    """(PATCH, PATCH) median of the greys round each cell where they count."""
    padded = np.pad(np.where(where, grey, np.nan).astype(np.float32), HALF, constant_values=np.nan)
    side = 2 * HALF + 1
    near = sliding_window_view(padded, (side, side))[..., ::STRIDE, ::STRIDE].reshape(PATCH * PATCH, -1)
    ordered = np.sort(near, axis=1)
    count = np.isfinite(near).sum(axis=1)
    middle = ordered[np.arange(len(ordered)), np.maximum(count - 1, 0) // 2]
    middle[count < FEWEST_LEVELS] = np.nan
    return np.asarray(middle.reshape(PATCH, PATCH), dtype=np.float64)


def _filled(levels: Array) -> Array:
    """Levels with those of the nearest cells where there are none."""
    known = np.isfinite(levels)
    weight, value = known.astype(np.float32), np.where(known, levels, 0.0).astype(np.float32)
    result = levels.copy()
    for sigma in SPREADS:
        missing = ~np.isfinite(result)
        if not missing.any():
            break
        over = cv2.GaussianBlur(weight, (0, 0), sigma)
        found = missing & (over > 1e-3)
        result[found] = cv2.GaussianBlur(value, (0, 0), sigma)[found] / over[found]
    return result


def local_levels(grey: Array, white: Array, seen: NDArray[np.bool_]) -> Levels:
    """Levels of a patch (PATCH, PATCH), with a drawing that is white (PATCH, PATCH) where 1, in the cells seen."""
    black = _medians(grey, seen & (white < DRAWN_BLACK))
    bright = _filled(_medians(grey, seen & (white > DRAWN_WHITE)))
    usual = bright - _filled(black)
    known = usual[np.isfinite(usual)]
    if len(known):
        # What is drawn black but isn't doesn't tell how dark black is there.
        black[usual < FAINT * float(np.median(known))] = np.nan
    return Levels(_filled(black), bright)


def check_shaded(patch: Patch, geometry: LandmarkGeometry, least: float, deepest: int | None = None) -> Proof:
    """Whether the patch agrees with the drawing in enough cells, and with no rival as well; its correlation is the part
    that agrees.

    Args:
        patch: At the map in question.
        geometry: Of the landmark.
        least: Part of the cells that must agree.
        deepest: Rivals that differ in contours further inside are left to a nearer look; None: none are.
    """
    rivals = geometry.rivals(PSF_SIGMA_PX / patch.cell_px)
    drawings = rivals.averaged
    seen = geometry.judged if patch.whole else geometry.judged & patch.seen
    levels = local_levels(patch.grey, rivals.templates[0].white, seen)
    contrast = levels.white - levels.black
    grey = cv2.blur(patch.grey, (AVERAGED, AVERAGED))
    with np.errstate(invalid="ignore"):
        tells = seen & (contrast > MIN_CONTRAST_DN) & (grey < MUTE_DN)
    count = int(tells.sum())
    if count < 0.2 * int(geometry.judged.sum()):
        return Proof(Rejection(Refusal.CONTRAST, f"{count} cells show black and white, the rest tells nothing"), 0.0)
    place = (grey[tells] - levels.black[tells]) / contrast[tells]
    like = np.abs(place - drawings[:, tells]) < LIKE
    share = float(like[0].mean())
    if share < least:
        text = f"{share * 100:.0f}% of it is as drawn in its own light, under {least * 100:.0f}%"
        return Proof(Rejection(Refusal.CORRELATION, text), share)
    differs = np.abs(drawings[:, tells] - drawings[0, tells]) > TELLS
    would = differs.sum(axis=1)
    ours, theirs = (differs & like[0] & ~like).sum(axis=1), (differs & ~like[0] & like).sum(axis=1)
    wrong = ours < np.maximum(ODDS * theirs, PART * would)
    wrong = np.where(would < FEWEST, rivals.must_differ, wrong)
    wrong[0] = False
    if deepest is not None:
        wrong &= rivals.contour <= deepest
    if wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        text = (
            f"could as well be the landmark {rivals.names[k]}: of {would[k]} cells that would tell "
            f"{ours[k]} are as drawn, {theirs[k]} the other way"
        )
        refusal = Refusal.HEADING if rivals.must_differ[k] else Refusal.INNER_CORRELATION
        return Proof(Rejection(refusal, text), share)
    return Proof(None, share)
