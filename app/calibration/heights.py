"""From frames of the landmark at known heights to the paper's height table (Table II, equation 11).

Frames fall into two groups by where the
landmark's centre lies: L1 in the middle of the image, L2 at the distance D from it. By similar triangles L = f s / H.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.calibration.board import NoView
from app.calibration.sample import Sample
from app.errors import CalibrationError
from app.estimation.height_table import outer_triangle
from app.landmark import Landmark
from app.vision.camera_model import Lens

SIGMA_MIN = 0.003
"""Of a length: of a few frames, more than half may agree by chance."""
OUTLIER = 5.0
"""A length this many robust sigmas from its row's median is left out."""
CENTRED_PART = 0.35
"""The first group's frames lie within this part of D; the second's within OFFSET_PART of D itself."""
OFFSET_PART = 0.25
APART = 3.0
"""The groups' distances from the middle differ by this factor at least."""
LEAST_PART = 0.02
"""Distances below this, in focal lengths, are all alike: nobody holds a camera better."""
MIDDLE_PART = 0.08
"""Without a second group: so far from the middle, in focal lengths, still counts as centred."""


@dataclass(frozen=True, slots=True)
class Row:
    """One height of the table.

    Attributes:
        height_m: Height.
        centred_px: L1, median.
        offset_px: L2, median.
        frames: Of each group.
        spread: Of each group, robust standard deviation over median.
    """

    height_m: float
    centred_px: float
    offset_px: float
    frames: tuple[int, int]
    spread: tuple[float, float]


@dataclass(frozen=True, slots=True)
class HeightCalibration:
    """A height table, and what it was made of.

    Attributes:
        rows: Heights rising.
        offset_distance_px: D.
        side_m: Side of the triangle.
        focal_px: Of the lens, and so of the table's pixels.
        law_focal_px: The focal length that the lengths speak for.
        law_zero_m: What must be added to the heights so that H L is constant.
        centred_only: There was no second group: L2 is L1, as through a perfect lens.
        samples: What was used, and the group of each: 0 centred, 1 offset.
        refused: What was not, and why.
    """

    rows: tuple[Row, ...]
    offset_distance_px: float
    side_m: float
    focal_px: float
    law_focal_px: float
    law_zero_m: float
    centred_only: bool
    samples: tuple[tuple[Sample, int], ...]
    refused: tuple[NoView, ...]

    def law_px(self, height_m: float) -> float:
        """Length at a height by the line through 1 / L."""
        return self.law_focal_px * self.side_m / (height_m + self.law_zero_m)

    def computed_px(self, height_m: float) -> float:
        """Length at a height that a perfect camera with this lens would see."""
        return self.focal_px * self.side_m / height_m


def make_table(
    samples: Sequence[Sample],
    refused: Sequence[NoView],
    landmark: Landmark,
    lens: Lens,
    *,
    centred_only: bool = False,
) -> HeightCalibration:
    """The table that the samples make.

    Args:
        samples: Of all heights and both groups.
        refused: Frames that gave no sample.
        landmark: With a triangle.
        lens: Of the camera.
        centred_only: There is no second group.

    Raises:
        CalibrationError: No triangle, no sample, no two groups, or no two heights that have both.
    """
    triangle = outer_triangle(landmark)
    if triangle is None:
        raise CalibrationError(
            f"landmark {landmark.name!r} has no triangle", "give the pad that the paper's method can use"
        )
    if not samples:
        words = f" (first: {refused[0].name}: {refused[0].reason})" if refused else ""
        raise CalibrationError(
            f"the landmark was seen in no frame with a known height{words}", "give frames that show it"
        )
    gone = list(refused)
    grouped, distance = _grouped(samples, gone, lens.focal_px, centred_only)
    rows = _rows(grouped, gone, centred_only)
    if len(rows) < 2:
        both = (
            ""
            if centred_only
            else " with frames of both groups, in the middle and at one and the same distance from it"
        )
        raise CalibrationError(f"{len(rows)} height(s){both}", f"give at least three heights{both}")
    side_m = triangle[1].side_m
    slope, zero = _line(rows)
    kept = tuple((s, g) for s, g in grouped if any(s.height_m == row.height_m for row in rows))
    return HeightCalibration(
        tuple(rows), distance, side_m, lens.focal_px, 1.0 / (slope * side_m), zero, centred_only, kept, tuple(gone)
    )


def _grouped(
    samples: Sequence[Sample], refused: list[NoView], focal_px: float, centred_only: bool
) -> tuple[list[tuple[Sample, int]], float]:
    """Samples with their group, and D. The groups are split where the distances, as ratios, jump most."""
    distances = np.sort([s.distance_px for s in samples])
    reach, least = MIDDLE_PART * focal_px, LEAST_PART * focal_px
    if centred_only:
        for s in samples:
            if s.distance_px > reach:
                refused.append(NoView(s.name, f"{s.distance_px:.0f} px from the middle, over {reach:.0f}"))
        kept = [(s, 0) for s in samples if s.distance_px <= reach]
        if not kept:
            raise CalibrationError(
                "the landmark is in the middle of no frame", "put it there, or leave --centred-only out"
            )
        return kept, focal_px
    gap = int(np.argmax(np.diff(np.log(np.maximum(distances, least))))) if len(distances) > 1 else 0
    limit = 0.5 * float(distances[gap] + distances[min(gap + 1, len(distances) - 1)])
    near, far = distances[distances <= limit], distances[distances > limit]
    middle, offset = (float(np.median(part)) if len(part) else 0.0 for part in (near, far))
    if not len(far) or offset < APART * max(middle, least):
        raise CalibrationError(
            f"the landmark's distances from the image's middle ({distances[0]:.0f} to {distances[-1]:.0f} px) do not "
            "fall into two groups",
            "at each height record it in the middle, and again at one and the same distance in pixels from it "
            "(about a quarter of the width); or give --centred-only",
        )
    result: list[tuple[Sample, int]] = []
    for s in samples:
        if s.distance_px <= CENTRED_PART * offset:
            result.append((s, 0))
        elif abs(s.distance_px - offset) <= OFFSET_PART * offset:
            result.append((s, 1))
        else:
            words = f"{s.distance_px:.0f} px from the middle: in neither group (up to {CENTRED_PART * offset:.0f}, or "
            words += f"{(1 - OFFSET_PART) * offset:.0f} to {(1 + OFFSET_PART) * offset:.0f})"
            refused.append(NoView(s.name, words))
    return result, float(np.median([s.distance_px for s, group in result if group == 1]))


def _rows(grouped: Sequence[tuple[Sample, int]], refused: list[NoView], centred_only: bool) -> list[Row]:
    """The heights that have frames of both groups."""
    rows: list[Row] = []
    for height in sorted({s.height_m for s, _ in grouped}):
        found = [_median([s for s, g in grouped if s.height_m == height and g == group], refused) for group in (0, 1)]
        centred, offset = found
        if centred_only:
            offset = centred
        if centred is None or offset is None:
            missing = "centred" if centred is None else "offset"
            refused.append(NoView(f"height {height:g} m", f"has no {missing} frame"))
            continue
        rows.append(Row(height, centred[0], offset[0], (centred[1], offset[1]), (centred[2], offset[2])))
    return rows


def _median(samples: Sequence[Sample], refused: list[NoView]) -> tuple[float, int, float] | None:
    """Median, count and relative spread of a row's lengths, outliers left out; None without any."""
    if not samples:
        return None
    sides = np.array([s.side_px for s in samples])
    middle = float(np.median(sides))
    sigma = max(1.4826 * float(np.median(np.abs(sides - middle))), SIGMA_MIN * middle)
    good = np.abs(sides - middle) <= OUTLIER * sigma
    for s, fine in zip(samples, good, strict=True):
        if not fine:
            words = f"side of {s.side_px:.2f} px, {abs(s.side_px - middle) / sigma:.0f} sigma from {middle:.2f}"
            refused.append(NoView(s.name, words))
    return float(np.median(sides[good])), int(good.sum()), sigma / middle if len(sides) > 1 else 0.0


def _line(rows: Sequence[Row]) -> tuple[float, float]:
    """Slope of 1 / L over H, and the height to be added so that it goes through zero (Theil, 1950; Sen, 1968: medians
    over pairs, so that one wrong height pulls nothing).
    """
    h = np.array([row.height_m for row in rows])
    slopes, zeros = [], []
    for lengths in ([row.centred_px for row in rows], [row.offset_px for row in rows]):
        inverse = 1.0 / np.array(lengths)
        i, j = np.triu_indices(len(rows), 1)
        slope = float(np.median((inverse[j] - inverse[i]) / (h[j] - h[i])))
        if slope <= 0:
            raise CalibrationError(
                "the landmark does not get smaller with height", "see that each frame has its own height"
            )
        slopes.append(slope)
        zeros.append(float(np.median(inverse / slope - h)))
    return float(np.mean(slopes)), float(np.mean(zeros))
