"""What the picture says for a map of the pad's plane and against it: the drawing must explain the grey of the
rectified patch, with the light, blur and tone that suit it best, and better than its rivals: the drawing turned, or
with a part of it upside down, missing, of another size or shape. Each test returns its refusal or None.

Shadows and covers that cross the landmark are left to agreement, which compares place by place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.align import uncensored
from app.vision.evidence import MIN_CONTRAST
from app.vision.geometry import LandmarkGeometry
from app.vision.patch import Patch, side_px
from app.vision.refusal import Refusal, Rejection
from app.vision.template import PSF_SIGMA_PX, Rivals, Template

MAX_CONTRAST = 300.0
"""A blurred landmark's black and white, worked out from its greys, may lie somewhat beyond 0 and 255."""
MAX_CONTRAST_CLIPPED = 1500.0
"""The same where white is saturated: as far as this the exposure may be wrong. Not for few pixels, though: with white
left open they are explained too easily, a letter O for one."""
CENSORED_ROUNDS = 4
INVERTED = 0.014
"""Part of the outermost square that may be black for white and, at the same time, white for black. A cover is one or
the other; a triangle upside down is both, by 4% each."""
LIKE_MIN = 0.5
WHOLE_MIN = 0.92
FEW_MIN, FEWEST_PX, FEW_PX = 0.98, 12.0, 24.0
"""Correlation of a small landmark's patch with the drawing as this light and lens show it; and of one of
FEWEST_PX or less, rising from FEW_PX on."""
AVERAGED_PX = 2.0
MARGIN = 0.15
"""How much better the drawing must explain the picture than a rival, as a part of the difference between the two."""
STRUCTURE, STRUCTURE_COSTS = 0.025, 10.0
"""What noise, blur and light leave unexplained, as a part of the contrast; and by how much more the margin grows for
each part that is left beyond. Rendered landmarks leave 0.01 to 0.05, what resembles them 0.05 and more."""
CLIPPED, CLIPPED_COSTS, CLIPPED_MOST = 0.3, 1.0, 0.35
"""The margin grows as well with the part of the picture that is saturated beyond this, which tells nothing."""
MIMICS = 0.06
"""A rival that leaves less than this is what the picture shows."""
INNERMOST_MIN_PX, FAR_BETTER = 8.0, 0.5
"""The innermost contour shows its shape from that side on; and another shape leaves less than this part of what the
drawn one leaves if it is there: 0.05 to 0.3 for triangles and diamonds, 0.9 and more where it is as drawn."""
CLEAR, CLEAR_PX = 0.95, 36.0
"""So well explained a picture of so many pixels has no shadow or cover in it: a rival it could as well be is not proven
wrong by looking place by place."""
SATURATED, NEAREST = 0.25, 4
"""Part of the picture that is saturated from which rivals are fitted to what is left, each by itself; and how many,
beside the landmark turned."""
BRIGHTEST_DN = 255.0
MIN_CELLS = 24
FLAT_PART = 0.03
"""What differs by less than this part of the contrast, root mean square, can't be told."""


def check_likeness(patch: Patch, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether a large landmark's patch resembles the drawing at all, shadows and covers allowed."""
    cells = _seen(patch, geometry.cells(None))
    if len(cells) < MIN_CELLS:
        return None
    found = explain_patch(patch, geometry, cells)
    if found.correlation < LIKE_MIN:
        text = f"correlation with the drawn landmark {found.correlation:.2f}, under {LIKE_MIN:.2f}"
        return Rejection(Refusal.CORRELATION, text)
    return None


def check_inverted(patch: Patch, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether black stands for white in one place and white for black in another."""
    template = geometry.template(PSF_SIGMA_PX / patch.cell_px)
    cells = _seen(patch, geometry.cells(None))
    white, grey = template.white.ravel()[cells], patch.grey.ravel()[cells]
    black_cells, white_cells = white < 0.1, white > 0.9
    if not (black_cells.any() and white_cells.any()):
        return None
    low, high = float(np.median(grey[black_cells])), float(np.median(grey[white_cells]))
    if high - low < MIN_CONTRAST:
        return Rejection(Refusal.CONTRAST, f"contrast {high - low:.0f} grey levels, under {MIN_CONTRAST:.0f}")
    area = len(geometry.cells(None)) * geometry.square_part
    too_white = float((grey[black_cells] > high - 0.3 * (high - low)).sum()) / area
    too_black = float((grey[white_cells] < low + 0.3 * (high - low)).sum()) / area
    if min(too_white, too_black) > INVERTED:
        text = f"{too_white * 100:.1f}% is white for black and {too_black * 100:.1f}% black for white"
        return Rejection(Refusal.CORRELATION, text)
    return None


@dataclass(frozen=True, slots=True)
class Explained:
    """How a drawing explains cells of a patch, with the light, blur and tone that suit it best.

    Attributes:
        correlation: Of the cells with what the drawing makes of them; 0 if black and white are the wrong way round.
        left: Sum of squares that is left.
        contrast: Grey levels from black to white.
        model: (cells,) what it makes of them.
        grey: (cells,) them; where they are saturated and the model brighter, what the model says.
    """

    correlation: float
    left: float
    contrast: float
    model: Array
    grey: Array


def _seen(patch: Patch, cells: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of the cells that lie in the image."""
    return cells if patch.whole else cells[patch.seen.ravel()[cells]]


def explain(grey: Array, template: Template, cells: NDArray[np.intp], clipped: NDArray[np.bool_] | None) -> Explained:
    """Fit a drawing's appearance to the grey (n,) of some cells, of which some (n,) may be saturated."""
    terms, inverse = template.at(cells)
    solution = np.asarray(inverse @ (terms.T @ grey), dtype=np.float64)
    model = np.asarray(terms @ solution, dtype=np.float64)
    if clipped is not None:
        for _ in range(CENSORED_ROUNDS):
            counts = np.where((clipped & (model >= grey))[:, None], 0.0, terms)
            held = counts.T @ terms + np.diag(1e-6 * len(cells) + template.hold)
            solution = np.asarray(np.linalg.solve(held, counts.T @ grey), dtype=np.float64)
            model = np.asarray(terms @ solution, dtype=np.float64)
    shown = uncensored(grey, clipped, model)
    off = shown - model
    left = float(off @ off)
    total = float(shown @ shown) - len(shown) * float(shown.mean()) ** 2
    contrast = float(solution[0])
    correlation = math.sqrt(max(0.0, 1.0 - left / total)) if total > 1e-6 and contrast > 0 else 0.0
    return Explained(correlation, left, contrast, model, shown)


def explain_patch(patch: Patch, geometry: LandmarkGeometry, cells: NDArray[np.intp]) -> Explained:
    """How the landmark explains the cells of a patch."""
    clipped = None if patch.clipped is None else patch.clipped[cells]
    return explain(patch.grey.ravel()[cells], geometry.template(PSF_SIGMA_PX / patch.cell_px), cells, clipped)


@dataclass(frozen=True, slots=True)
class Proof:
    """What became of a picture.

    Attributes:
        rejection: None if it is the landmark.
        correlation: Of the picture with the drawing.
        mimic: Whether a rival explains it well, so that no shadow or cover can be to blame.
    """

    rejection: Rejection | None
    correlation: float
    mimic: bool = False


def check_picture(patch: Patch, geometry: LandmarkGeometry) -> Proof:
    """Whether the drawing explains a patch whose map is right, and no rival does as well.

    A rival that differs in less than the picture can show says nothing, but for the landmark turned: with its heading
    open it is refused.
    """
    cells = _seen(patch, geometry.cells(None))
    if len(cells) < MIN_CELLS:
        return Proof(Rejection(Refusal.TOO_SMALL, "too little of it lies in the image"), 0.0)
    best = explain_patch(patch, geometry, cells)
    if best.contrast < MIN_CONTRAST:
        text = f"contrast {best.contrast:.0f} grey levels, under {MIN_CONTRAST:.0f}"
        return Proof(Rejection(Refusal.CONTRAST, text), best.correlation)
    most = MAX_CONTRAST if patch.clipped is None or side_px(patch) < FEW_PX else MAX_CONTRAST_CLIPPED
    if best.contrast > most:
        text = f"contrast {best.contrast:.0f} grey levels, over {most:.0f}: no print is whiter than white"
        return Proof(Rejection(Refusal.CONTRAST, text), best.correlation)
    # Few pixels are easily explained.
    few = (FEW_PX - side_px(patch)) / (FEW_PX - FEWEST_PX)
    least = WHOLE_MIN + (FEW_MIN - WHOLE_MIN) * min(1.0, max(0.0, few))
    rivals = geometry.rivals(PSF_SIGMA_PX / patch.cell_px)
    expected, found = rivals.left(np.column_stack([best.model, best.grey]), cells).T
    expected, found = expected - expected[0], found - found[0]
    same = expected < len(cells) * (FLAT_PART * best.contrast) ** 2
    part = np.where(same, np.where(rivals.must_differ, -math.inf, math.inf), found / np.maximum(expected, 1e-9))
    part[0] = math.inf
    k = int(part.argmin())
    structure = _structure(patch, cells, best.grey - best.model) / best.contrast
    clipped = 0.0 if patch.clipped is None else float(patch.clipped[cells].mean())
    margin = MARGIN + STRUCTURE_COSTS * max(0.0, structure - STRUCTURE)
    unsure = min(CLIPPED_MOST, CLIPPED_COSTS * max(0.0, clipped - CLIPPED))
    if part[k] < margin + unsure:
        margin += unsure
    elif clipped > SATURATED and best.correlation >= least:
        nearest = [*np.flatnonzero(rivals.must_differ).tolist(), *np.argsort(part)[:NEAREST].tolist()]
        for k in dict.fromkeys(nearest):
            if k > 0:
                part[k], same[k] = _beside_saturation(patch, cells, best, rivals, k)
            if part[k] < margin:
                break
    if part[k] < margin:
        text = (
            f"could as well be the landmark {rivals.names[k]}: {part[k] * 100:.0f}% of the difference to expect, under "
            f"{margin * 100:.0f}%"
        )
        if part[k] < 0.0 and not same[k]:
            other = explain(best.grey, rivals.templates[k], cells, None)
            off = _structure(patch, cells, best.grey - other.model)
            mimic = other.contrast > 0.0 and off < MIMICS * other.contrast
        else:
            mimic = False
        # In a clear picture nothing is in the way that a look place by place would have to let in.
        mimic |= best.correlation > CLEAR and side_px(patch) > CLEAR_PX and part[k] < MARGIN and not same[k]
        refusal = Refusal.HEADING if rivals.must_differ[k] else Refusal.INNER_CORRELATION
        if best.correlation < least and not mimic:
            refusal = Refusal.CORRELATION
        return Proof(Rejection(refusal, text), best.correlation, mimic)
    if best.correlation < least:
        text = f"correlation with the drawn landmark {best.correlation:.3f}, under {least:.3f}"
        return Proof(Rejection(Refusal.CORRELATION, text), best.correlation)
    return Proof(None, best.correlation)


def check_innermost(patch: Patch, geometry: LandmarkGeometry) -> Rejection | None:
    """Whether the innermost contour has another shape than drawn: seen from so near, that shape explains the picture
    far better. Where it is covered or in a glare, no shape does.

    Args:
        patch: At the map in question, of the innermost contour alone.
        geometry: Of that contour.
    """
    if not patch.whole or side_px(patch) < INNERMOST_MIN_PX:
        return None
    cells = geometry.cells(None)
    clipped = None if patch.clipped is None else patch.clipped[cells]
    rivals, grey = geometry.rivals(PSF_SIGMA_PX / patch.cell_px), patch.grey.ravel()[cells]
    own = explain(grey, rivals.templates[0], cells, clipped)
    others = np.flatnonzero(rivals.reshaped)
    if clipped is None:
        others = others[[rivals.left(grey[:, None], cells)[others, 0].argmin()]]
    found = [(k, explain(grey, rivals.templates[k], cells, clipped)) for k in others.tolist()]
    k, best = min(found, key=lambda o: o[1].left)
    if best.contrast > MIN_CONTRAST and best.left < FAR_BETTER * own.left:
        part = best.left / own.left
        text = f"it is the landmark {rivals.names[k]}, which leaves {part * 100:.0f}% of what the drawn one leaves"
        return Rejection(Refusal.INNER_CORRELATION, text)
    return None


def _beside_saturation(
    patch: Patch, cells: NDArray[np.intp], best: Explained, rivals: Rivals, rival: int
) -> tuple[float, bool]:
    """How much better the landmark explains the cells than a rival does, as a part of what is to expect, each fitted to
    what the saturation leaves; and whether it leaves too little to tell the two apart.
    """
    template, grey = rivals.templates[rival], patch.grey.ravel()[cells]
    clipped = None if patch.clipped is None else patch.clipped[cells]
    seen = np.minimum(best.model, BRIGHTEST_DN)
    expected = explain(seen, template, cells, best.model >= BRIGHTEST_DN).left
    if expected < len(cells) * (FLAT_PART * best.contrast) ** 2:
        return (-math.inf if rivals.must_differ[rival] else math.inf), True
    return (explain(grey, template, cells, clipped).left - best.left) / expected, False


def _structure(patch: Patch, cells: NDArray[np.intp], off: Array) -> float:
    """Root mean square, in grey levels, of what differs, averaged over some pixels: noise averages out, another drawing
    doesn't.
    """
    spread = np.zeros(patch.grey.size)
    spread[cells] = off
    window = max(3, round(AVERAGED_PX / patch.cell_px) | 1)
    smooth = cv2.blur(spread.reshape(patch.grey.shape), (window, window)).ravel()[cells]
    return math.sqrt(float(smooth @ smooth) / len(cells))
