"""Sub-pixel sides and corners: where the grey crosses from black to white across each side of a landmark that is laid
on the image, a straight line through those points on the tangent plane, and corners where lines meet.

The sides come from the drawing, not from the binary image, so contours that the threshold missed can be found too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.camera_model import Lens
from app.vision.fit import project_pad
from app.vision.geometry import SAMPLES_PER_SIDE, LandmarkGeometry
from app.vision.preprocess import Prepared

STEPS = 9
"""Grey values across a side."""
CENTRED_REACH_PX = 2.2
"""How far they reach from an edge known to a fraction of a pixel: over the blur of lens and Gaussian."""
WIDE_PX = 2.0
"""With this much room black and white are seen as they are."""
_S = np.linspace(-1.0, 1.0, STEPS)
NARROWEST_PX = 1.2
"""A side with less room than this on each side of it, up to the next edge, is not measured."""
MIN_CONTRAST = 8.0
CONTRAST_PART = 0.35
"""An edge must have this part of the median contrast of all."""
MIN_SEEN = 0.5
"""Part of the points along a side that must show the edge."""


@dataclass(frozen=True, slots=True)
class Sides:
    """What was measured along the sides of some contours.

    Attributes:
        found: (c,) for each side of the landmark, whether it was found.
        corners_plane: (c, 2) corners on the tangent plane; meaningful where both sides that meet were found.
        corner_found: (c,) whether they were.
        seen: (c,) part of the points along the side that show the edge.
        sigma_plane: (c,) scatter of the points about their line, on the tangent plane.
        contrast: Median step of grey across the edges; 0 if none was found.
    """

    found: NDArray[np.bool_]
    corners_plane: Array
    corner_found: NDArray[np.bool_]
    seen: Array
    sigma_plane: Array
    contrast: float


def _profiles(prepared: Prepared, px: Array, step: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Grey (n, STEPS) along px + s step, s from -1 to 1, of points (n, 2), and which lie inside the region."""
    image = prepared.smooth if prepared.reduction == 1 else prepared.grey
    at = (px - prepared.region[:2])[:, None, :] + step[:, None, :] * _S[:, None]
    at32 = at.astype(np.float32)
    if not math.isfinite(float(at32.sum())):
        at32 = np.nan_to_num(at32, nan=-10.0)
    height, width = image.shape
    ends = at32[:, [0, STEPS - 1]]
    low, high = ends.reshape(-1, 4).min(axis=1), ends.reshape(-1, 2, 2).max(axis=1)
    inside = (low >= 0) & (high[:, 0] <= width - 1) & (high[:, 1] <= height - 1)
    grey = cv2.remap(image, at32[..., 0], at32[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return grey.astype(np.float64), inside


def _median(values: Array) -> float:
    """The upper median; 0 of nothing. For so few values a sort is faster than numpy's median."""
    return float(np.sort(values)[len(values) // 2]) if len(values) else 0.0


def _levels(rising: Array) -> tuple[Array, Array]:
    """Black and white (n,) on either side of the middle of profiles (n, STEPS) that rise from black to white."""
    half = STEPS // 2
    return rising[:, : half + 1].min(axis=1), rising[:, half:].max(axis=1)


def _crossings(rising: Array, level: Array) -> Array:
    """Where profiles (n, STEPS) that rise from black to white cross a level (n,), in -1..1; not a number where not."""
    before, after = rising[:, :-1], rising[:, 1:]
    crosses = (before < level[:, None]) & (after >= level[:, None])
    rise = np.where(crosses, after - before, 1.0)
    where = _S[:-1] + (level[:, None] - before) / rise * (2.0 / (STEPS - 1))
    distance = np.where(crosses, np.abs(where), np.inf)
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(rising))
    return np.where(crosses[rows, nearest], where[rows, nearest], np.nan)


def _lines(points: Array, weight: Array) -> tuple[Array, Array]:
    """Lines (c, 3) n . p + d = 0 through points (c, m, 2) of weight (c, m), robustly, and their scatter (c,)."""
    robust = weight
    line = np.zeros((len(points), 3))
    sigma = np.zeros(len(points))
    for _ in range(2):
        total = robust.sum(axis=1) + 1e-12
        mean = (robust[:, None] @ points)[:, 0] / total[:, None]
        d = points - mean[:, None]
        dx, dy = d[..., 0], d[..., 1]
        xx, xy, yy = (robust * dx * dx).sum(1), (robust * dx * dy).sum(1), (robust * dy * dy).sum(1)
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        nx, ny = -np.sin(angle), np.cos(angle)
        off = dx * nx[:, None] + dy * ny[:, None]
        sigma = np.sqrt((robust * off * off).sum(1) / total)
        line[:, 0], line[:, 1], line[:, 2] = nx, ny, -(nx * mean[:, 0] + ny * mean[:, 1])
        robust = weight / (1.0 + (off / (2.0 * sigma[:, None] + 1e-12)) ** 2)
    return line, sigma


def measure_sides(
    prepared: Prepared,
    rays_from_pad: Array,
    basis: Array,
    geometry: LandmarkGeometry,
    lens: Lens,
    contours: range,
    reach_px: float,
) -> Sides:
    """Look for the sides of some contours within reach_px of where a fit puts them.

    Args:
        prepared: Region of the frame.
        rays_from_pad: (3, 3) the fit (see app.vision.fit).
        basis: (3, 3) tangent_from_cam, for the lines.
        geometry: Of the landmark.
        lens: Of the camera.
        contours: Neighbours; sides of the others are reported as not found.
        reach_px: How far from the fit an edge may be; narrower where the next edge is near.
    """
    total = len(geometry.corners)
    part = slice(geometry.slices[contours[0]].start, geometry.slices[contours[-1]].stop)
    base = geometry.side_points[part]
    count = len(base)
    outward = geometry.side_normals[part] * (0.45 * geometry.gap_m[part])[:, None]
    both = np.concatenate([base.reshape(-1, 2), (base + outward[:, None]).reshape(-1, 2)])
    px, seen = project_pad(rays_from_pad, both, lens)
    n = count * SAMPLES_PER_SIDE
    px, step, valid = px[:n], px[n:] - px[:n], seen[:n] & seen[n:]
    room = np.hypot(step[:, 0], step[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        direction = step / room[:, None]
        valid &= room >= NARROWEST_PX
    sign = np.repeat(geometry.side_sign[part], SAMPLES_PER_SIDE)
    edge_px = px
    wide = room >= WIDE_PX
    middle: float | None = None
    # Once to find the edge; once more from there, as black and white are judged by what lies equally far on both sides.
    for reach in (reach_px, min(reach_px, CENTRED_REACH_PX)):
        step = direction * np.minimum(room, reach)[:, None]
        grey, inside = _profiles(prepared, edge_px, step)
        rising = grey * sign[:, None]
        low, high = _levels(rising)
        contrast = high - low
        level = 0.5 * (low + high)
        if middle is not None:
            # A band of two or three pixels never gets as black or as white as it is; its edges still cross the middle.
            level = np.where(wide, level, np.clip(sign * middle, low + 0.1 * contrast, high - 0.1 * contrast))
        where = _crossings(rising, level)
        valid &= inside & np.isfinite(where) & (contrast >= MIN_CONTRAST)
        edge_px = edge_px + step * np.where(valid, where, 0.0)[:, None]
        clear = valid & wide
        if clear.any():
            middle = _median((sign * level)[clear])
    typical = _median(contrast[valid])
    valid &= contrast >= CONTRAST_PART * typical

    rays = lens.rays(np.where(valid[:, None], edge_px, 0.0)) @ basis.T
    valid &= rays[:, 2] > 0.05
    plane = np.where(valid[:, None], rays[:, :2] / rays[:, 2:], 0.0).reshape(count, SAMPLES_PER_SIDE, 2)
    weight = valid.reshape(count, SAMPLES_PER_SIDE).astype(np.float64)
    lines, sigma = _lines(plane, weight)

    part_seen = weight.mean(axis=1)
    found_part = part_seen >= MIN_SEEN
    previous = geometry.previous[part] - part.start
    a, b, c = lines.T
    a0, b0, c0 = lines[previous].T
    bend = a0 * b - b0 * a
    good = found_part & found_part[previous] & (np.abs(bend) > 1e-3)
    bend = np.where(good, bend, 1.0)
    corners = np.full((total, 2), np.nan)
    corners[part, 0] = (b0 * c - c0 * b) / bend
    corners[part, 1] = (c0 * a - a0 * c) / bend
    found, corner_found = np.zeros(total, dtype=bool), np.zeros(total, dtype=bool)
    all_seen, all_sigma = np.zeros(total), np.zeros(total)
    found[part], corner_found[part], all_seen[part], all_sigma[part] = found_part, good, part_seen, sigma
    return Sides(found, corners, corner_found, all_seen, all_sigma, typical)
