"""Where a patch agrees with the drawing, place by place: what shadows and covers leave of the proof.

In a small window round each cell the grey is compared with the drawing by itself, so the light there may be anything.
A cell agrees, or it tells nothing (covered, crossed by a shadow's edge). The drawing must agree in most of the places
where it shows something, and where it differs from a rival (turned, a part upside down or missing) it must agree
clearly more often than the rival.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.geometry import PSF_SIGMA_PX, LandmarkGeometry
from app.vision.patch import Patch
from app.vision.refusal import Refusal, Rejection

WINDOW = 5
"""Cells."""
SHOWS = 0.1
"""Standard deviation of the drawing in a window, black 0 and white 1, from which it tells something."""
LIKE = 0.65
"""Squared correlation in a window that counts as agreement."""
FAINT = 0.25
"""Contrast in a window, as a part of the usual one, that counts."""
MIN_AGREE = 0.52
"""Part of the places that must agree."""
MIN_INSIDE = 0.42
"""The same inside the second contour."""
UNTOUCHED = 0.95
"""A shadow or a cover that hides what lies inside reaches over the outer contours too: if these agree by more than
this, another drawing lies inside."""
EVEN = 0.8
"""The outer white is in one light if its darkest tenth is as far above black as this part of its brightest tenth."""
FEWEST = 12
ODDS = 2.5
"""The drawing must agree in so many times the places where a rival agrees and it doesn't."""
MIN_CONTRAST_DN = 10.0


@dataclass(frozen=True, slots=True)
class Agreement:
    """How one drawing compares.

    Attributes:
        like: (PATCH, PATCH) where it agrees.
        shows: (PATCH, PATCH) where it tells something and the image is seen.
        contrast: Usual grey levels from black to white where it agrees.
    """

    like: NDArray[np.bool_]
    shows: NDArray[np.bool_]
    contrast: float

    def share(self, where: NDArray[np.bool_]) -> float:
        """Part of the places there that agree."""
        return float((self.like & where).sum()) / max(1, int(where.sum()))


def _mean(values: Array) -> Array:
    return np.asarray(cv2.blur(values.astype(np.float32), (WINDOW, WINDOW)), dtype=np.float64)


class _Grey:
    """What is worked out once from a patch."""

    def __init__(self, patch: Patch) -> None:
        self.grey = patch.grey
        self.mean = _mean(patch.grey)
        self.variance = np.maximum(_mean(patch.grey * patch.grey) - self.mean**2, 4.0)


def compare(grey: _Grey, white: Array, seen: NDArray[np.bool_]) -> Agreement:
    """Compare a patch with a drawing (PATCH, PATCH) of how white each cell is."""
    mean = _mean(white)
    variance = _mean(white * white) - mean**2
    both = _mean(white * grey.grey) - mean * grey.mean
    shows = seen & (variance > SHOWS * SHOWS)
    safe = np.maximum(variance, 1e-6)
    contrast = both / safe
    like = shows & (both > 0) & (both * both >= LIKE * safe * grey.variance)
    usual = float(np.median(contrast[like])) if like.any() else 0.0
    like &= contrast >= max(FAINT * usual, MIN_CONTRAST_DN * 0.5)
    return Agreement(like, shows, usual)


def _is_unevenly_lit(patch: Patch, white: Array, seen: NDArray[np.bool_], geometry: LandmarkGeometry) -> bool:
    """Whether the print's outer white is darker in some places than in others."""
    rim = seen & geometry.rim
    bright, dark = patch.grey[rim & (white > 0.9)], patch.grey[rim & (white < 0.1)]
    if min(len(bright), len(dark)) < FEWEST:
        return True
    black = float(np.median(dark))
    low, high = (float(v) for v in np.percentile(bright, (10, 90)))
    return low - black < EVEN * (high - black)


def check_agreement(
    patch: Patch, geometry: LandmarkGeometry, least: float = MIN_AGREE
) -> tuple[Rejection | None, float]:
    """Whether the patch agrees with the drawing in enough places, and with no rival as well; and in which part.

    Args:
        patch: At the map in question.
        geometry: Of the landmark.
        least: Part of the places that must agree.
    """
    sigma = PSF_SIGMA_PX / patch.cell_px
    seen = geometry.judged if patch.whole else geometry.judged & patch.seen
    grey = _Grey(patch)
    template = geometry.template(sigma)
    mine = compare(grey, template.white, seen)
    share = mine.share(mine.shows)
    if mine.contrast < MIN_CONTRAST_DN:
        text = f"contrast {mine.contrast:.0f} grey levels, under {MIN_CONTRAST_DN:.0f}"
        return Rejection(Refusal.CONTRAST, text), share
    if share < least or int(mine.shows.sum()) < 4 * FEWEST:
        text = f"{share * 100:.0f}% of its places are as drawn, under {least * 100:.0f}%"
        return Rejection(Refusal.CORRELATION, text), share
    within = geometry.inside(min(1, len(geometry.landmark.contours) - 1))
    inside = mine.shows & within
    touched = mine.share(mine.shows & ~within) < UNTOUCHED or _is_unevenly_lit(patch, template.white, seen, geometry)
    if not touched and mine.share(inside) < UNTOUCHED:
        text = f"inside {mine.share(inside) * 100:.0f}% is as drawn, though nothing covers or shades what is round it"
        return Rejection(Refusal.INNER_CORRELATION, text), share
    if inside.any() and mine.share(inside) < MIN_INSIDE:
        text = f"{mine.share(inside) * 100:.0f}% of what lies inside is as drawn, under {MIN_INSIDE * 100:.0f}%"
        return Rejection(Refusal.INNER_CORRELATION, text), share
    rivals = geometry.rivals(sigma)
    for name, must_differ, coarse, rival in zip(
        rivals.names, rivals.must_differ, rivals.coarse, rivals.templates, strict=True
    ):
        if not coarse:
            continue
        theirs = compare(grey, rival.white, seen)
        ours, others = int((mine.like & ~theirs.like).sum()), int((theirs.like & ~mine.like).sum())
        if ours + others < FEWEST and not must_differ:
            continue
        if ours < max(FEWEST, ODDS * others):
            text = (
                f"could as well be the landmark {name}: {ours} places agree with the one alone, {others} with the other"
            )
            return Rejection(Refusal.HEADING if must_differ else Refusal.INNER_CORRELATION, text), share
    return None, share
