"""The detector: one frame in, one Detection out. In a sequence the threshold and the region of interest carry over.

It owns the order of things (which region, which grey level, how many tries); each stage is a module of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.config import VisionConfig
from app.errors import ImageError
from app.landmark import Landmark
from app.messages import Detection, Frame, Image, SeenContour
from app.vision.camera_model import Lens
from app.vision.candidates import Bench, Candidate, Found, examine
from app.vision.contours import nests
from app.vision.fit import project_pad
from app.vision.geometry import LandmarkGeometry
from app.vision.preprocess import Prepared, Region, binarise, global_otsu, grow, otsu, prepare, whole
from app.vision.threshold import Search, ThresholdState, after_miss, after_success, ladder, threshold_now

ROI_MARGIN_PX = 32
ROI_MARGIN_PART = 0.35
"""Margin round the landmark, in sides of it: what it may move from one frame to the next."""
FULL_SIDE_PX = 190.0
"""A landmark with a larger outer side is searched at half the resolution, or a third, ...; edges are always measured
at the full one."""
SEARCH_WIDTH_PX = 960
"""Wider frames are searched at a lower resolution too, in turn with the full one."""
MAX_NESTS = 12
GOOD_RUN = 3
GOOD_SCORE = 0.8
"""A candidate with this many contours and this score ends the search."""
RETRY_LEVELS = 8
"""A second try in the region is worth it if its own Otsu level differs by this much."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """One region at one threshold: what the drawing shows.

    Attributes:
        prepared: The region.
        threshold: Grey level.
        binary: At the resolution of prepared.smooth.
        candidates: What was looked at.
        found: The best that was confirmed.
    """

    prepared: Prepared
    threshold: int
    binary: Image
    candidates: tuple[Candidate, ...]
    found: Found | None

    @property
    def reason(self) -> str:
        """Why nothing was found: the refusal of the candidate that came nearest."""
        refused = [c.rejection for c in self.candidates if c.rejection is not None]
        if not refused:
            return f"no dark square with another contour in it at threshold {self.threshold}"
        return max(refused, key=lambda r: r.test).text

    @property
    def progress(self) -> int:
        """How far the best candidate came."""
        return max((int(c.rejection.test) for c in self.candidates if c.rejection is not None), default=-1)


class Detector:
    """Finds the landmark.

    Args:
        landmark: What to look for.
        lens: Of the camera.
        config: [vision].
    """

    def __init__(self, landmark: Landmark, lens: Lens, config: VisionConfig) -> None:
        self.geometry = LandmarkGeometry(landmark)
        self.lens = lens
        self.config = config
        self.threshold = ThresholdState()
        self.roi: Region | None = None
        self.reduction = 1
        self.attempt: Attempt | None = None
        """What the last frame's drawing shows."""

    def reset(self) -> None:
        """Forget the sequence."""
        self.threshold, self.roi, self.reduction, self.attempt = ThresholdState(), None, 1, None

    def detect(
        self, frame: Frame, *, still: bool = False, predicted_px: tuple[float, float] | None = None
    ) -> Detection:
        """Look for the landmark in a frame. `elapsed_s` of the result is 0: who owns a clock may fill it in.

        Args:
            frame: Of the lens's size.
            still: The frame stands alone: all thresholds are tried on it, and nothing is carried over.
            predicted_px: Where the middle of the landmark is expected (u, v), if the caller knows better than
                "where it was".

        Raises:
            ImageError: The frame is not of the lens's size.
        """
        height, width = frame.image.shape[:2]
        if (width, height) != self.lens.size_px:
            wide, high = self.lens.size_px
            raise ImageError(
                f"{frame.name or 'frame'}: {width}x{height} pixels, the camera file says {wide}x{high}",
                "give images of that size, or the camera file that belongs to them",
            )
        if still:
            attempt = self._still(frame.image)
            region = whole(frame.image)
        else:
            attempt = self._next(frame.image, predicted_px)
            region = attempt.prepared.region
        self.attempt = attempt
        roi = None if region == whole(frame.image) else region
        found = attempt.found
        if found is None:
            return Detection(
                frame.t_capture_s, frame.sequence, reason=attempt.reason, threshold=attempt.threshold, roi_px=roi
            )
        seen = tuple(SeenContour(found.first + i, px) for i, px in enumerate(found.corners_px))
        return Detection(
            frame.t_capture_s,
            frame.sequence,
            contours=seen,
            code=found.code(self.geometry),
            score=found.judgement.score,
            threshold=attempt.threshold,
            roi_px=roi,
        )

    def _search(self, image: Image, region: Region, reduction: int, level: int) -> Attempt:
        """One region at one threshold."""
        prepared = prepare(image, region, reduction=reduction, sigma_px=self.config.blur_sigma_px)
        return self._binarised(prepared, level)

    def _binarised(self, prepared: Prepared, level: int) -> Attempt:
        config = self.config
        binary = binarise(prepared.smooth, level)
        bench = Bench(prepared, self.geometry, self.lens, config.min_side_px, config.min_score, config.blur_sigma_px)
        candidates: list[Candidate] = []
        best: Found | None = None
        for nest in nests(prepared, binary, self.geometry, self.lens, config.min_side_px)[:MAX_NESTS]:
            found, looked_at = examine(nest, bench)
            candidates += looked_at
            for one in found:
                rank = (len(one.corners_px), one.judgement.score)
                if best is None or rank > (len(best.corners_px), best.judgement.score):
                    best = one
            if best is not None and len(best.corners_px) >= GOOD_RUN and best.judgement.score >= GOOD_SCORE:
                break
        return Attempt(prepared, level, binary, tuple(candidates), best)

    def _still(self, image: Image) -> Attempt:
        """All thresholds on one image, Otsu's first; the attempt that came nearest if none finds it."""
        config = self.config
        levels = [
            global_otsu(image),
            *ladder(config.sweep_from, config.sweep_to, config.sweep_step),
            *ladder(config.wide_from, config.wide_to, config.wide_step),
        ]
        coarse = -(-image.shape[1] // SEARCH_WIDTH_PX)
        nearest: Attempt | None = None
        for reduction in dict.fromkeys((coarse, 1)):
            prepared = prepare(image, whole(image), reduction=reduction, sigma_px=config.blur_sigma_px)
            for level in dict.fromkeys(levels):
                attempt = self._binarised(prepared, level)
                if attempt.found is not None:
                    return attempt
                if nearest is None or attempt.progress > nearest.progress:
                    nearest = attempt
        assert nearest is not None
        return nearest

    def _next(self, image: Image, predicted_px: tuple[float, float] | None) -> Attempt:
        """The next frame of a sequence."""
        global_level = global_otsu(image)
        level = threshold_now(self.threshold, self.config, global_level)
        roi = self._region(predicted_px) if self.threshold.search is Search.TRACK else None
        if roi is not None:
            attempt = self._search(image, roi, self.reduction, level)
            if attempt.found is None:
                own = otsu(attempt.prepared.smooth)
                if abs(own - level) >= RETRY_LEVELS:
                    attempt = self._binarised(attempt.prepared, own)
        else:
            coarse = -(-image.shape[1] // SEARCH_WIDTH_PX)
            reduction = 1 if self.threshold.misses % 2 else coarse
            attempt = self._search(image, whole(image), reduction, level)
        if attempt.found is None:
            self.threshold = after_miss(self.threshold, self.config)
            if self.threshold.search is not Search.TRACK:
                self.roi, self.reduction = None, 1
        else:
            self._carry_over(attempt, attempt.found, global_level)
        return attempt

    def _carry_over(self, attempt: Attempt, found: Found, global_level: int) -> None:
        """Threshold, region and resolution for the frame after a success."""
        landmark = self.geometry.landmark
        zone = self.geometry.side_points[self.geometry.slices[0]].reshape(-1, 2)
        zone = np.concatenate([zone, landmark.contours[0].corners_m]) * (landmark.quiet_zone_m / landmark.size_m)
        px, seen = project_pad(found.fit.rays_from_pad, zone, self.lens)
        width, height = self.lens.size_px
        if not seen.all():
            tight: Region = (0, 0, width, height)
        else:
            low, high = px.min(axis=0), px.max(axis=0)
            tight = grow((int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1), 0, (width, height))
        side_px = found.scale_px * landmark.size_m
        self.roi = grow(tight, ROI_MARGIN_PX + ROI_MARGIN_PART * side_px, (width, height))
        self.reduction = max(1, math.ceil(side_px / FULL_SIDE_PX))
        u0, v0, u1, v1 = attempt.prepared.region
        r = attempt.prepared.reduction
        rows = slice(max(0, tight[1] - v0) // r, max(1, (min(tight[3], v1) - v0) // r))
        columns = slice(max(0, tight[0] - u0) // r, max(1, (min(tight[2], u1) - u0) // r))
        part = attempt.prepared.smooth[rows, columns]
        roi_level = otsu(part) if part.size else attempt.threshold
        self.threshold = after_success(self.threshold, self.config, roi_level, global_level)

    def _region(self, predicted_px: tuple[float, float] | None) -> Region | None:
        """Where to look: the region of interest, moved to where the landmark is expected."""
        if self.roi is None or predicted_px is None:
            return self.roi
        u0, v0, u1, v1 = self.roi
        half_u, half_v = (u1 - u0) // 2, (v1 - v0) // 2
        u, v = round(predicted_px[0]), round(predicted_px[1])
        moved = grow((u - half_u, v - half_v, u + half_u, v + half_v), 0, self.lens.size_px)
        return moved if moved[2] - moved[0] > 16 and moved[3] - moved[1] > 16 else self.roi
