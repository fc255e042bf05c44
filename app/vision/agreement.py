"""Where a patch agrees with the drawing, place by place: what shadows and covers leave of the proof.

In a small window round each cell the grey is compared with the drawing by itself, so the light there may be anything.
A place agrees, or it doesn't, or it is mute (the light saturates it). The drawing must agree in most of the places
where it shows something; and of the places where it differs from a rival (turned, a part upside down, missing, larger,
of another shape) it must agree in a good part, and clearly more often than the rival does.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.geometry import LandmarkGeometry
from app.vision.patch import Patch
from app.vision.picture import Proof
from app.vision.refusal import Refusal, Rejection
from app.vision.template import LIKE, PSF_SIGMA_PX, WINDOW, Rivals

FAINT = 0.25
"""Contrast in a window, as a part of the usual one, that counts."""
FLAT = 0.08
"""Standard deviation in a window, as a part of the usual contrast, under which the image shows nothing."""
MUTE_DN = 250.0
"""A window whose mean is brighter is saturated."""
MIN_AGREE, MIN_AGREE_WHOLE = 0.5, 0.7
"""Part of the places that must agree: of what lies inside, and of the whole landmark. Rendered landmarks under shadows,
glare and covers reach 0.50 and 0.71; with a contour of another size or turned 0.68 agree at most."""
FEWEST = 20
FEWEST_TO_WIN = 12
"""Places that suit a rival alone, from which it is what the picture shows."""
ODDS = 2.5
"""The drawing must agree in so many times the places where a rival agrees and it doesn't."""
PART = 0.2
"""And in this part of all the places that would tell the two apart."""
DETAIL = 40
"""A rival that differs in fewer places may be hidden by a cover altogether: it must not agree better, that is all."""
MIN_CONTRAST_DN = 10.0


@dataclass(frozen=True, slots=True)
class Agreement:
    """How the drawing and its rivals compare with a patch.

    Attributes:
        like: (n, PATCH, PATCH) where each agrees; the landmark is the first.
        tells: (PATCH, PATCH) where the image is seen and not saturated.
        contrast: Usual grey levels from black to white where the landmark agrees.
    """

    like: NDArray[np.bool_]
    tells: NDArray[np.bool_]
    contrast: float


def _mean(values: Array) -> Array:
    return np.asarray(cv2.blur(values.astype(np.float32), (WINDOW, WINDOW)), dtype=np.float64)


def compare(patch: Patch, rivals: Rivals, seen: NDArray[np.bool_]) -> Agreement:
    """Compare a patch with the landmark and its rivals at the patch's own blur.

    Args:
        patch: At the map in question.
        rivals: Of the landmark, at that blur.
        seen: (PATCH, PATCH) cells to look at.
    """
    mean = _mean(patch.grey)
    variance = np.maximum(_mean(patch.grey * patch.grey) - mean * mean, 4.0)
    windows = rivals.windows
    both = np.stack([_mean(white * patch.grey) for white in windows.white]) - windows.mean * mean
    contrast = both / windows.safe
    like = windows.shows & (both > 0) & (both * both >= LIKE * windows.safe * variance)
    usual = float(np.median(contrast[0][like[0] & seen])) if (like[0] & seen).any() else 0.0
    like &= contrast >= max(FAINT * usual, 0.5 * MIN_CONTRAST_DN)
    # What is drawn flat is right where the image is.
    like |= ~windows.shows & (variance < (FLAT * usual) ** 2)
    return Agreement(like, seen & (mean < MUTE_DN), usual)


def check_agreement(
    patch: Patch, geometry: LandmarkGeometry, least: float = MIN_AGREE, deepest: int | None = None
) -> Proof:
    """Whether the patch agrees with the drawing in enough places, and with no rival as well; its correlation is the
    part that agrees. A rival that agrees in clearly more places is what the picture shows.

    Args:
        patch: At the map in question.
        geometry: Of the landmark.
        least: Part of the places that must agree, MIN_AGREE or MIN_AGREE_WHOLE.
        deepest: Rivals that differ in contours further inside are left to a nearer look; None: none are.
    """
    rivals = geometry.rivals(PSF_SIGMA_PX / patch.cell_px)
    found = compare(patch, rivals, geometry.judged if patch.whole else geometry.judged & patch.seen)
    shown = found.tells & rivals.windows.shows[0]
    count, agree = int(shown.sum()), int((found.like[0] & shown).sum())
    share = agree / max(1, count)
    if found.contrast < MIN_CONTRAST_DN:
        text = f"contrast {found.contrast:.0f} grey levels, under {MIN_CONTRAST_DN:.0f}"
        return Proof(Rejection(Refusal.CONTRAST, text), share)
    if share < least or count < 4 * FEWEST:
        text = f"{share * 100:.0f}% of its places are as drawn, under {least * 100:.0f}%"
        return Proof(Rejection(Refusal.CORRELATION, text), share)
    where = rivals.windows.differs & found.tells
    ours = (found.like[0] & ~found.like & where).sum(axis=(1, 2))
    theirs = (~found.like[0] & found.like & where).sum(axis=(1, 2))
    would = where.sum(axis=(1, 2))
    least_of = np.where(would < DETAIL, 0.0, PART * would)
    least_of = np.maximum(np.where(rivals.must_differ, np.maximum(least_of, FEWEST), least_of), ODDS * theirs)
    wrong = (ours < least_of) & ((would >= FEWEST) | rivals.must_differ)
    wrong[0] = False
    if deepest is not None:
        wrong &= rivals.contour <= deepest
    if wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        text = (
            f"could as well be the landmark {rivals.names[k]}: of {would[k]} places that would tell "
            f"{ours[k]} agree with the one alone, {theirs[k]} with the other"
        )
        mimic = bool((wrong & (theirs > np.maximum(FEWEST_TO_WIN, ODDS * ours))).any())
        refusal = Refusal.HEADING if rivals.must_differ[k] else Refusal.INNER_CORRELATION
        return Proof(Rejection(refusal, text), share, mimic)
    return Proof(None, share)
