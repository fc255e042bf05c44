"""The detector: one frame in, one Detection out. In a sequence the map of the pad's plane, the threshold and the region
of interest carry over.

It owns the order of things: first the landmark is sought where it was, by its edges; then in the region round it and in
the whole frame, by the paper's way (threshold, contours, polygons, Table I) and by what helps where a contour is too
small, cut off or covered. Each stage is a module of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from app.config import VisionConfig
from app.errors import ImageError
from app.frames import Array
from app.landmark import Landmark, Shape
from app.messages import Detection, Frame, Image, PlaneFit, SeenContour
from app.vision.blobs import blobs
from app.vision.camera_model import Lens
from app.vision.candidates import (
    FOLLOWED_SHARE,
    RELIT_MIN_PX,
    SHADED_MIN_PX,
    Candidate,
    confirm,
    confirm_large,
    confirm_partial,
    confirm_relit,
    confirm_ring,
    confirm_shaded,
    confirm_small,
    examine,
    follow_large,
)
from app.vision.contours import Tree, contour_tree, nests
from app.vision.fit import project_pad
from app.vision.geometry import LandmarkGeometry
from app.vision.partial import outlines, readings, sides
from app.vision.patch import Patch, View, rectify
from app.vision.preprocess import (
    Prepared,
    Region,
    binarise,
    global_otsu,
    grow,
    local_binary,
    otsu,
    prepare,
    to_grey,
    whole,
)
from app.vision.refine import FINE_REACH_PX
from app.vision.refusal import Refusal, Rejection
from app.vision.ring import rings
from app.vision.threshold import ThresholdState, after_miss, after_success, ladder, threshold_now
from app.vision.verdict import SMALL_PX, Found

ROI_MARGIN_PX = 32
ROI_MARGIN_PART = 0.35
"""Margin round the landmark, in sides of it: what it may move from one frame to the next."""
FULL_SIDE_PX = 190.0
"""A landmark with a larger outer side is searched at half the resolution, or a third, ...; edges are always measured
at the full one."""
SEARCH_WIDTH_PX = 960
"""Wider frames are searched at a lower resolution too, in turn with the full one."""
MAX_NESTS = 12
WIDE_REACHES_PX = (9.0, 4.0, FINE_REACH_PX)
FOLLOWED = "followed"
PROVE_EACH = 15
"""Frames: each half second."""
BLIND_MOST = 30
"""Frames: a second."""
TRACK_STEPS = 6
TRACK_MISSES = 5
"""So many frames the landmark is sought where it was."""
PREDICTED_S = 0.2
"""Over a longer time it is not expected to go on moving as it did."""
EXCESS, EXCESS_UNSEEN = 2.2, 5.0
"""Squared errors of poses over what the fits' scatter says: measured on the benchmark's frames, whose renderer shares
nothing with these fits."""
LOCAL_WINDOWS_PX = (13, 81)
"""The local threshold compares a pixel with the mean of a window of so many pixels round it."""
PATIENT_AFTER = 30
"""Frames of a sequence without the landmark after which the costly ways take turns: what comes into view stays for
many frames, and a companion computer that searches for minutes must keep up."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """One way to look for the landmark: what the drawing shows.

    Attributes:
        how: In a word.
        region: Of the frame.
        threshold: Grey level; 0 where each place has its own.
        binary: Of the region, at a lower resolution maybe; None where none was made.
        candidates: What was looked at.
        found: The first that was confirmed.
    """

    how: str
    region: Region
    threshold: int
    binary: Image | None
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


@dataclass(frozen=True, slots=True)
class Track:
    """Where the landmark was.

    Attributes:
        rays_from_pad: (3, 3) at its last sight.
        motion: (3, 3) by which the map moved in a second, as a warp less the identity; zeros if not known.
        t_s: When that was.
        side_px: Its outer side.
        misses: Frames since.
        look: Its picture there.
        followed: Frames in which it was followed since it was last searched for.
        blind: Frames since its inside was last seen.
    """

    rays_from_pad: Array
    motion: Array
    t_s: float
    side_px: float
    look: Patch
    misses: int = 0
    followed: int = 0
    blind: int = 0


def _honest(found: Found) -> Array:
    """(8, 8) information of a fit, less what its own scatter doesn't tell: errors that neighbouring pixels share (lens,
    blur, light), and more of them where a part of the edges is not as drawn.
    """
    result: Array = found.information / (EXCESS * (1.0 + EXCESS_UNSEEN * (1.0 - found.share)))
    return result


class Detector:
    """Finds the landmark.

    Args:
        landmark: What to look for.
        lens: Of the camera.
        config: [vision].
        geometry: Of the landmark, where there is one already: it keeps much that takes time to make.
    """

    def __init__(
        self, landmark: Landmark, lens: Lens, config: VisionConfig, geometry: LandmarkGeometry | None = None
    ) -> None:
        self.geometry = LandmarkGeometry(landmark) if geometry is None else geometry
        self.lens = lens
        self.config = config
        self.threshold = ThresholdState()
        self.track: Track | None = None
        self.last: tuple[View, Array] | None = None
        """The last frame that showed the landmark, and its map: the next threshold comes from them."""
        self.attempt: Attempt | None = None
        """What the last frame's drawing shows."""
        self._fruitless = 0

    def reset(self) -> None:
        """Forget the sequence."""
        self.threshold, self.track, self.last, self.attempt = ThresholdState(), None, None, None
        self._fruitless = 0

    def detect(
        self, frame: Frame, *, still: bool = False, predicted_px: tuple[float, float] | None = None
    ) -> Detection:
        """Look for the landmark in a frame. `elapsed_s` of the result is 0: who owns a clock may fill it in.

        Args:
            frame: Of the lens's size.
            still: The frame stands alone: all thresholds are tried on it, and nothing is carried over.
            predicted_px: Where the middle of the landmark is expected (u, v), if the caller knows better than
                "as it moved before".

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
        grey = to_grey(frame.image, whole(frame.image))
        view = View(grey, (0, 0), self.geometry, self.lens)
        attempt = self._still(view) if still else self._next(view, frame.t_capture_s, predicted_px)
        self.attempt = attempt
        found = attempt.found
        roi = None if attempt.region == whole(grey) else attempt.region
        if found is None:
            return Detection(
                frame.t_capture_s, frame.sequence, reason=attempt.reason, threshold=attempt.threshold, roi_px=roi
            )
        corners = found.corners_px(view)
        if attempt.how == FOLLOWED:
            roi = self._surrounding(corners[0], found.side_px)
        return Detection(
            frame.t_capture_s,
            frame.sequence,
            contours=tuple(SeenContour(k, px) for k, px in zip(found.contours, corners, strict=True)),
            code=found.code(self.geometry),
            score=found.score,
            threshold=attempt.threshold or round(found.level),
            roi_px=roi,
            plane=PlaneFit(found.rays_from_pad, _honest(found), self.geometry.unit_m, found.residual_px),
        )

    # ------------------------------------------------------------------------------------------------------ one look
    def _look(self, view: View, prepared: Prepared, binary: Image, level: int, how: str, thorough: bool) -> Attempt:
        """One binary image; thorough: by single sides and corners too."""
        config = self.config
        candidates: list[Candidate] = []
        tree = contour_tree(binary)
        for nest in nests(prepared, tree, self.geometry, self.lens, config.min_side_px)[:MAX_NESTS]:
            found, looked_at = examine(nest, view, config.min_side_px)
            candidates += looked_at
            if found is not None and found.side_px >= config.min_side_px:
                return Attempt(how, prepared.region, level, binary, tuple(candidates), found)
        for word, outline_px, way in self._hypotheses(tree, prepared, view, thorough):
            result = self._large_enough(way())
            candidates.append(Candidate((outline_px,), word, result if isinstance(result, Rejection) else None))
            if isinstance(result, Found):
                return Attempt(how, prepared.region, level, binary, tuple(candidates), result)
        return Attempt(how, prepared.region, level, binary, tuple(candidates), None)

    def _hypotheses(
        self, tree: Tree, prepared: Prepared, view: View, thorough: bool
    ) -> Iterator[tuple[str, Array, Callable[[], Found | Rejection]]]:
        """What a binary image may show beside nests: what it was made from, in a word; where; and how to confirm it."""
        if self.geometry.landmark.contours[0].shape is Shape.SQUARE:
            for maps, box in blobs(tree, prepared, view):
                yield "small", box, partial(confirm, maps, range(2), view)
        if not thorough:
            return
        seen = outlines(tree, prepared, view)
        for side in sides(seen):
            for k, start in readings(side, self.geometry):
                yield "side", side.outline_px, partial(confirm_partial, start, k, view)
        for ring in rings(seen, view):
            yield "ring", ring.outline_px, partial(confirm_ring, ring, view)

    def _large_enough(self, found: Found | Rejection) -> Found | Rejection:
        """What was found, unless its outer side is shorter than it may be."""
        if isinstance(found, Rejection) or found.side_px >= self.config.min_side_px:
            return found
        text = f"side {found.side_px:.1f} px, under {self.config.min_side_px:.1f} px"
        return Rejection(Refusal.TOO_SMALL, text)

    def _by_level(self, view: View, prepared: Prepared, level: int, thorough: bool = True) -> Attempt:
        """At one grey level."""
        return self._look(view, prepared, binarise(prepared.smooth, level), level, "threshold", thorough)

    def _by_place(self, view: View, prepared: Prepared, window_px: int, thorough: bool = True) -> Attempt:
        """Each place against the mean of its surroundings."""
        return self._look(view, prepared, local_binary(prepared.smooth, window_px), 0, "local threshold", thorough)

    # --------------------------------------------------------------------------------------------------------- stills
    def _still(self, view: View) -> Attempt:
        """All thresholds on one image, Otsu's first; the attempt that came nearest if none finds it."""
        config, image = self.config, view.image
        coarse = -(-image.shape[1] // SEARCH_WIDTH_PX)
        first = global_otsu(image)
        levels = dict.fromkeys(
            [
                *ladder(config.sweep_from, config.sweep_to, config.sweep_step),
                *ladder(config.wide_from, config.wide_to, config.wide_step),
            ]
        )
        nearest: Attempt | None = None
        for prepared, level, window_px, thorough in self._looks(view, coarse, first, levels):
            if window_px:
                attempt = self._by_place(view, prepared, window_px, thorough)
            else:
                attempt = self._by_level(view, prepared, level, thorough)
            if attempt.found is not None:
                return attempt
            if nearest is None or attempt.progress > nearest.progress:
                nearest = attempt
        assert nearest is not None
        return nearest

    def _looks(
        self, view: View, coarse: int, first: int, levels: Iterable[int]
    ) -> Iterator[tuple[Prepared, int, int, bool]]:
        """What a frame that stands alone is looked at through: a region, a grey level or the window of a local
        threshold, and whether single sides and corners are worth their time.
        """
        everything, sigma_px = whole(view.image), self.config.blur_sigma_px
        prepared = prepare(view.image, everything, reduction=coarse, sigma_px=sigma_px)
        yield prepared, first, 0, False
        for window_px in LOCAL_WINDOWS_PX:
            yield prepared, 0, window_px, False
        yield prepared, first, 0, True
        yield prepared, 0, LOCAL_WINDOWS_PX[-1], True
        fine = prepared if coarse == 1 else prepare(view.image, everything, sigma_px=sigma_px)
        for level in levels:
            yield fine, level, 0, False
        half = prepare(view.image, everything, reduction=coarse + 1, sigma_px=sigma_px)
        yield half, 0, LOCAL_WINDOWS_PX[-1], True

    # ------------------------------------------------------------------------------------------------------ sequences
    def _next(self, view: View, t_s: float, predicted_px: tuple[float, float] | None) -> Attempt:
        """The next frame of a sequence."""
        attempt = self._where_it_was(view, t_s, predicted_px)
        if attempt is None or attempt.found is None:
            self._settle_threshold()
            attempt = self._search(view, global_otsu(view.image))
        self._fruitless = self._fruitless + 1 if attempt.found is None else 0
        if attempt.found is None:
            self.threshold = after_miss(self.threshold, self.config)
            if self.track is not None:
                self.track = replace(self.track, misses=self.track.misses + 1)
                if self.track.misses > TRACK_MISSES:
                    self.track = None
        else:
            self._carry_over(view, attempt.found, t_s, attempt.how == FOLLOWED)
        return attempt

    def _expected(self, track: Track, t_s: float, predicted_px: tuple[float, float] | None) -> list[Array]:
        """Maps to begin from: as the landmark moved before, and where it was."""
        maps: list[Array] = []
        ahead_s = t_s - track.t_s
        if predicted_px is not None:
            ray = self.lens.rays(np.array([predicted_px]))[0]
            centre = track.rays_from_pad[:, 2]
            length = float(np.linalg.norm(centre))
            if np.isfinite(ray).all():
                moved = track.rays_from_pad.copy()
                moved[:, 2] = ray * length
                maps.append(moved)
        if 0.0 < ahead_s < PREDICTED_S and np.any(track.motion):
            maps.append(track.rays_from_pad @ (np.eye(3) + track.motion * ahead_s))
        maps.append(track.rays_from_pad)
        return maps

    def _where_it_was(self, view: View, t_s: float, predicted_px: tuple[float, float] | None) -> Attempt | None:
        """By its edges or its picture, from where it is expected; None if nothing is known."""
        track = self.track
        if track is None:
            return None
        everything = range(len(self.geometry.landmark.contours))
        candidates: list[Candidate] = []
        maps = self._expected(track, t_s, predicted_px)
        # Now and then a landmark that is followed is told from its rivals anew.
        before = track.look if track.misses == 0 and track.followed % PROVE_EACH != 0 else None
        led = track.misses == 0 and track.blind < BLIND_MOST
        ways: list[Callable[[], Found | Rejection]] = []
        for k, matrix in enumerate(maps):
            if track.side_px < SMALL_PX:
                ways.append(partial(confirm_small, matrix, view, TRACK_STEPS, before))
                continue
            if led and k == 0:
                ways.append(partial(follow_large, matrix, view, before))
            ways.append(partial(confirm_large, matrix, everything, view, WIDE_REACHES_PX))
        if RELIT_MIN_PX <= track.side_px < SMALL_PX:
            ways.append(partial(confirm_relit, maps[0], view))
        if track.side_px >= SHADED_MIN_PX:
            ways.append(partial(confirm_shaded, maps[0], view, led))
        best: Found | None = None
        for way in ways:
            found = self._large_enough(way())
            if isinstance(found, Rejection):
                candidates.append(Candidate((), FOLLOWED, found))
            elif best is None or found.share > best.share:
                best = found
            if best is not None and best.share >= FOLLOWED_SHARE:
                break
        if best is not None:
            return Attempt(FOLLOWED, whole(view.image), 0, None, (), best)
        return Attempt(FOLLOWED, whole(view.image), 0, None, tuple(candidates), None)

    def _settle_threshold(self) -> None:
        """The paper's threshold for the next frame, from the last one that showed the landmark: Otsu's on the region
        round it. It is worked out only where it is needed: a landmark that is followed needs none.
        """
        if self.last is None:
            return
        view, rays_from_pad = self.last
        self.last = None
        patch = rectify(view, rays_from_pad)
        roi_level = otsu(np.asarray(np.clip(patch.grey, 0, 255), dtype=np.uint8))
        self.threshold = after_success(self.threshold, self.config, roi_level, global_otsu(view.image))

    def _search(self, view: View, global_level: int) -> Attempt:
        """In the region round where it was, then in the whole frame."""
        level = threshold_now(self.threshold, self.config, global_level)
        nearest: Attempt | None = None
        track, sigma = self.track, self.config.blur_sigma_px
        if track is not None:
            region = self._round(track.rays_from_pad, track.side_px)
            reduction = max(1, math.ceil(track.side_px / FULL_SIDE_PX))
            prepared = prepare(view.image, region, reduction=reduction, sigma_px=sigma)
            window = max(9, int(track.side_px / reduction / 2.5) | 1)
            for k in range(2):
                attempt = self._by_level(view, prepared, level) if k == 0 else self._by_place(view, prepared, window)
                if attempt.found is not None:
                    return attempt
                if nearest is None or attempt.progress > nearest.progress:
                    nearest = attempt
        coarse = -(-view.image.shape[1] // SEARCH_WIDTH_PX)
        turn = self.threshold.misses
        prepared = prepare(view.image, whole(view.image), reduction=coarse if turn % 2 == 0 else 1, sigma_px=sigma)
        # Of three frames of a long search one has no local threshold, and each way is thorough in one.
        third = self._fruitless % 3 if self._fruitless >= PATIENT_AFTER else None
        attempt = self._by_level(view, prepared, global_level if track is not None else level, third in (None, 0))
        if attempt.found is None and third != 0:
            window_px = LOCAL_WINDOWS_PX[turn % len(LOCAL_WINDOWS_PX)]
            local = self._by_place(view, prepared, window_px, third in (None, 1))
            if local.found is not None or local.progress > attempt.progress:
                attempt = local
        return attempt if nearest is None or attempt.found is not None else nearest

    def _round(self, rays_from_pad: Array, side_px: float) -> Region:
        """The region round the quiet zone of a map."""
        landmark = self.geometry.landmark
        zone = landmark.contours[0].corners_m * (landmark.quiet_zone_m / landmark.size_m)
        px, seen = project_pad(
            rays_from_pad, np.concatenate([zone, 0.5 * (zone + np.roll(zone, 1, axis=0))]), self.lens
        )
        width, height = self.lens.size_px
        if not seen.all():
            return 0, 0, width, height
        region = self._surrounding(px, side_px)
        return region if region[2] - region[0] > 16 and region[3] - region[1] > 16 else (0, 0, width, height)

    def _surrounding(self, corners_px: Array, side_px: float) -> Region:
        """The region round a contour's corners (k, 2) in which it was followed."""
        low, high = np.clip(corners_px.min(axis=0), -1e4, 1e4), np.clip(corners_px.max(axis=0), -1e4, 1e4)
        box: Region = (int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1)
        return grow(box, ROI_MARGIN_PX + ROI_MARGIN_PART * side_px, self.lens.size_px)

    def _carry_over(self, view: View, found: Found, t_s: float, followed: bool) -> None:
        """What the next frame begins with."""
        motion = np.zeros((3, 3))
        track = self.track
        if track is not None and 0.0 < t_s - track.t_s < PREDICTED_S:
            moved = np.linalg.inv(track.rays_from_pad) @ found.rays_from_pad
            moved /= moved[2, 2]
            # Shift, size and turn; what the rest would add is noise.
            size, turn = 0.5 * (moved[0, 0] + moved[1, 1]) - 1.0, 0.5 * (moved[0, 1] - moved[1, 0])
            motion = np.array([[size, turn, moved[0, 2]], [-turn, size, moved[1, 2]], [0.0, 0.0, 0.0]])
            motion /= t_s - track.t_s
        count = track.followed + 1 if followed and track is not None else 0
        blind = track.blind + 1 if found.blind and track is not None else 0
        self.track = Track(found.rays_from_pad, motion, t_s, found.side_px, found.look, followed=count, blind=blind)
        self.last = view, found.rays_from_pad
