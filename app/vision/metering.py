"""What a frame says of the light: the grey levels of the pad's white and black, and the middle grey of the picture.

The pad is sampled at points of the drawing, well inside its black and its white, that the detection's plane puts into
the image. It decides nothing; exposure.py does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.landmark import Landmark
from app.messages import Detection, Frame, Image
from app.vision.camera_model import Lens

Grey = NDArray[np.uint8]

GRID = 56
"""Points along a side of the drawing; as many of each colour as there are, the ones far from edges first."""
SAMPLES_MAX = 150
"""Of each colour."""
EDGE_PX = 1.5
"""Nearer to an edge a pixel is mixed, by the lens's blur and a little motion."""
SAMPLES_MIN = 12
"""Fewer of a colour that are free of edges, and the ones farthest from edges are taken instead: a small pad."""
WHITE_SHARE = 0.7
BLACK_SHARE = 0.3
"""Of the white, so much may lie under glare, and of the black too, without a say; in the same way a shadow over most
of the pad leaves the say to the lit white, that it must not saturate."""
SATURATED = 250
"""Grey level from which the sensor may have had more light than it tells."""
MIDDLE_STEP = 4
"""The picture is metered on every fourth pixel of its middle half."""
HIGHLIGHT_STEP = 2
HIGHLIGHT_SAMPLES = 16
"""Highlights are looked for on every second pixel each way: as many samples are a part of a pad's white, when the pad
is so small or so far in the shade that there is little more of it; a glint or the sensor's noise has fewer."""
HIGHLIGHT_ANGLE_RAD = math.radians(60.0)
"""Farther from the optical axis than this lies the sky, when the vehicle leans."""


@dataclass(frozen=True, slots=True)
class PadLight:
    """The pad's grey levels in one frame.

    Attributes:
        white: Of its lit white.
        black: Of its black.
        saturated: Share of the white that is saturated.
        centre_px: (2,) where its middle is in the image.
        cover: Its area over that of the picture's metered middle, whether it lies there or not.
    """

    white: float
    black: float
    saturated: float
    centre_px: Array
    cover: float


def middle_grey(image: Image) -> float:
    """The median grey level of a picture's middle half: neither the sky in a fisheye's corners nor a glare moves it."""
    height, width = image.shape[:2]
    part = image[height // 4 : 3 * height // 4 : MIDDLE_STEP, width // 4 : 3 * width // 4 : MIDDLE_STEP]
    if part.ndim == 3:
        part = np.asarray(cv2.cvtColor(np.ascontiguousarray(part), cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return float(np.median(part))


class HighlightMeter:
    """Reads what is brightest on the ground.

    Args:
        lens: Of the camera.
    """

    def __init__(self, lens: Lens) -> None:
        width, height = lens.size_px
        v, u = np.mgrid[0:height:HIGHLIGHT_STEP, 0:width:HIGHLIGHT_STEP]
        rays = lens.rays(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
        with np.errstate(invalid="ignore"):
            near = rays[:, 2] >= math.cos(HIGHLIGHT_ANGLE_RAD) * np.linalg.norm(rays, axis=1)
        self._mask: Grey = np.where(near.reshape(u.shape), 255, 0).astype(np.uint8)

    def read(self, image: Image) -> float:
        """Grey level that only a few pixels of the frame (of the lens's size) exceed."""
        part = np.ascontiguousarray(image[::HIGHLIGHT_STEP, ::HIGHLIGHT_STEP])
        if part.ndim == 3:
            part = np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        counts = cv2.calcHist([part], [0], self._mask, [256], [0, 256]).ravel()
        above = np.cumsum(counts[::-1])
        return float(max(0, 255 - int(np.searchsorted(above, HIGHLIGHT_SAMPLES))))


class PadMeter:
    """Reads the pad's grey levels.

    Args:
        landmark: On the pad.
        lens: Of the camera.
    """

    def __init__(self, landmark: Landmark, lens: Lens) -> None:
        self._landmark = landmark
        self._lens = lens
        self._white, self._black = _sample_points(landmark)

    def read(self, frame: Frame, detection: Detection) -> PadLight | None:
        """The pad's light; None if the pad isn't in the frame, or too little of it to tell."""
        plane = self._plane(detection)
        if plane is None:
            return None
        centre, px_per_m = self._scale(plane)
        if centre is None:
            return None
        margin_m = EDGE_PX / px_per_m
        chosen = (_chosen(self._white, margin_m), _chosen(self._black, margin_m))
        white, black = self._grey(frame.image, plane, chosen)
        if white.size < SAMPLES_MIN or black.size < SAMPLES_MIN:
            return None
        return PadLight(
            _share(white, WHITE_SHARE),
            _share(black, BLACK_SHARE),
            np.count_nonzero(white >= SATURATED) / white.size,
            centre,
            4.0 * (self._landmark.quiet_zone_m * px_per_m) ** 2 / (frame.image.shape[0] * frame.image.shape[1]),
        )

    def _plane(self, detection: Detection) -> Array | None:
        """(3, 3) rays_from_pad: the detection's own, or a fit of it to the corners (direct linear transform)."""
        if detection.plane is not None:
            return detection.plane.rays_from_pad
        if not detection.detected:
            return None
        px = np.concatenate([seen.corners_px for seen in detection.contours])
        pad = np.concatenate([self._landmark.contours[seen.index].corners_m for seen in detection.contours])
        rays = self._lens.rays(px)
        if not np.isfinite(rays).all():
            return None
        unit = self._landmark.size_m
        points = np.column_stack([pad / unit, np.ones(len(pad))])
        # ray x (H p) = 0, two rows of it for each point; the third depends on them.
        zero = np.zeros_like(points)
        x, y, z = (rays[:, k : k + 1] for k in range(3))
        rows = np.concatenate([np.hstack([zero, -z * points, y * points]), np.hstack([z * points, zero, -x * points])])
        found: Array = np.linalg.svd(rows)[2][-1].reshape(3, 3) / np.array([unit, unit, 1.0])
        return found if float(rays[0] @ found @ (*pad[0], 1.0)) > 0.0 else -found

    def _scale(self, plane: Array) -> tuple[Array | None, float]:
        """The pad's middle in the image, and pixels a metre there (the smaller of both directions)."""
        step = 0.05 * self._landmark.size_m
        points = np.array([[0.0, 0.0, 1.0], [step, 0.0, 1.0], [0.0, step, 1.0]])
        px, seen = self._lens.project(points @ plane.T)
        if not seen.all():
            return None, 1.0
        along = np.linalg.norm(px[1:] - px[0], axis=1) / step
        return px[0], max(float(along.min()), 1e-6)

    def _grey(self, image: Image, plane: Array, points: tuple[Array, Array]) -> tuple[Grey, Grey]:
        """Grey levels at two sets of points (n, 2) forward, right, as far as they lie in the image."""
        both = np.concatenate(points)
        px, seen = self._lens.project(both @ plane[:, :2].T + plane[:, 2])
        height, width = image.shape[:2]
        at = np.rint(np.where(seen[:, None], px, -1.0)).astype(np.intp)
        u, v = at.T
        inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
        grey: Grey = image[v[inside], u[inside]]
        if grey.ndim == 2:
            grey = np.asarray(np.rint(grey @ np.array([0.114, 0.587, 0.299])), dtype=np.uint8)
        first = np.count_nonzero(inside[: len(points[0])])
        return grey[:first], grey[first:]


def _chosen(points: Array, margin_m: float) -> Array:
    """(n, 2) of the points (m, 3), the farthest from edges first, that are free of edges; the first few at least."""
    free = int(np.searchsorted(-points[:, 2], -margin_m))
    free = min(len(points), max(free, 4 * SAMPLES_MIN))
    # Evenly from all of them, so that the samples lie all over the pad.
    return points[: free : -(-free // SAMPLES_MAX), :2]


def _share(grey: Grey, share: float) -> float:
    """The grey level that this share of the samples does not exceed."""
    index = min(len(grey) - 1, int(share * len(grey)))
    return float(np.partition(grey, index)[index])


def _sample_points(landmark: Landmark) -> tuple[Array, Array]:
    """White and black points (n, 3): forward, right, distance to the nearest edge, m; the farthest from edges first."""
    half = 0.5 * landmark.quiet_zone_m
    line = (np.arange(GRID) + 0.5) / GRID * 2.0 * half - half
    points = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    black = np.zeros(len(points), dtype=bool)
    distance = half - np.abs(points).max(axis=1)
    for contour in landmark.contours:
        depth = _depth_m(contour.corners_m, points)
        black[depth > 0.0] = contour.black
        distance = np.minimum(distance, np.abs(depth))
    table = np.column_stack([points, distance])
    table = table[np.argsort(-distance, kind="stable")]
    dark = black[np.argsort(-distance, kind="stable")]
    return table[~dark], table[dark]


def _depth_m(corners: Array, points: Array) -> Array:
    """(n,) how deep points lie in a convex outline (clockwise from above): the distance to its nearest side.

    Outside it is negative, and no farther from zero than the distance.
    """
    along = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    depth: Array = (points @ inward.T - np.sum(inward * corners, axis=1)).min(axis=1)
    return depth
