"""One frame's world for the negatives: pose, lens, light, sensor, and prints on a background.

Cheap on purpose: a lookup a pixel for the background, supersampling only where a print lies. The lens is the
benchmark's own geometry (optics.py), not the application's camera model.
Ground frame: forward, right in camera heights; the camera is 1 above it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from decoys import PRINT_PX, Print
from negative_ground import Plane, tile
from numpy.typing import NDArray
from optics import HEIGHT, WIDTH, Optics, lens

Points = NDArray[np.float64]
Grey = NDArray[np.uint8]
CAM_FROM_LEVEL = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
HORIZON = 0.08
"""Down component of a ray below which it looks at the sky."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the camera looks.

    Attributes:
        lens: Of the benchmark.
        cam_from_level: (3, 3).
        points: (HEIGHT, WIDTH, 2) float32 what each pixel sees of the ground: forward, right.
        slope: (HEIGHT, WIDTH) float32 1 / down component of the ray.
        sky: (HEIGHT, WIDTH) bool.
    """

    lens: Optics
    cam_from_level: Points
    points: Plane
    slope: Plane
    sky: NDArray[np.bool_]

    def pixels(self, ground: Points) -> Points:
        """(n, 2) where points (n, 2) of the ground are seen; not a number where they can't be."""
        return np.asarray(self.lens.project(np.column_stack([ground, np.ones(len(ground))]) @ self.cam_from_level.T))


def pose(lens_name: str, tilt_rad: float, towards_rad: float) -> Pose:
    """A camera that leans by an angle from straight down, towards a direction of the image."""
    optics = lens(lens_name)
    axis = np.array([math.cos(towards_rad), math.sin(towards_rad), 0.0]) * tilt_rad
    rotation = np.asarray(cv2.Rodrigues(axis)[0] @ CAM_FROM_LEVEL)
    rays = optics.grid[1:-1, 1:-1].reshape(-1, 3) @ rotation.astype(np.float32)
    rays = rays.reshape(HEIGHT, WIDTH, 3)
    sky = rays[..., 2] < HORIZON
    slope = np.float32(1.0) / np.maximum(rays[..., 2], np.float32(HORIZON))
    return Pose(optics, rotation, rays[..., :2] * slope[..., None], slope, sky)


@dataclass(frozen=True, slots=True)
class Place:
    """Where a print lies.

    Attributes:
        at: (2,) forward, right of its middle.
        yaw_rad: Its heading.
        side: Outer side, in camera heights.
        corners_px: (4, 2) of its outer square (side 1 of the print), as seen.
    """

    at: Points
    yaw_rad: float
    side: float
    corners_px: Points

    @property
    def side_px(self) -> float:
        """Shortest side as seen."""
        return float(np.min(np.linalg.norm(np.roll(self.corners_px, -1, axis=0) - self.corners_px, axis=1)))


UNIT = np.array([[0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]])


def _turned(points: Points, yaw: float) -> Points:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def place_at(seen: Pose, px: tuple[float, float], yaw_rad: float, side_px: float) -> Place | None:
    """A print seen at a pixel whose shortest side is side_px there; None in the sky or past the lens's edge."""
    u, v = round(px[0]), round(px[1])
    if not (0 <= u < WIDTH and 0 <= v < HEIGHT) or seen.sky[v, u]:
        return None
    at = seen.points[v, u].astype(np.float64)
    side = side_px / seen.lens.f
    place = None
    for _ in range(5):
        corners = seen.pixels(_turned(UNIT * side, yaw_rad) + at)
        place = Place(at, yaw_rad, side, corners)
        if not np.isfinite(corners).all() or place.side_px < 1e-3:
            return None
        side *= side_px / place.side_px
    return place if place is not None and abs(place.side_px / side_px - 1) < 0.05 else None


# ------------------------------------------------------------------------------------------------------ background
def texture(seen: Pose, name: str, variant: int, px_per_texel: float, source: np.random.Generator) -> Plane:
    """(HEIGHT, WIDTH) 0..1 of a ground seen so that a texel spans that many pixels below the camera."""
    turn = source.uniform(0, math.tau)
    c, s = (np.float32(math.cos(turn)), np.float32(math.sin(turn)))
    scale = np.float32(seen.lens.f / px_per_texel)
    shift = source.uniform(0, 1024, 2).astype(np.float32)
    forward, right = seen.points[..., 0], seen.points[..., 1]
    x = (c * right + s * forward) * scale + shift[0]
    y = (s * right - c * forward) * scale + shift[1]
    footprint = seen.slope * np.sqrt(seen.slope) * np.float32(1 / px_per_texel)
    picture = tile(name, variant).look_up(x, y, footprint)
    picture[seen.sky] = np.float32(source.uniform(0.5, 1.0))
    return picture


def lay(picture: Plane, seen: Pose, drawn: Print, place: Place) -> None:
    """Paint a print into a picture of reflectance, its edges averaged over each pixel."""
    rim = np.vstack(
        [a + t * (b - a) for a, b in zip(UNIT, np.roll(UNIT, -1, 0), strict=True) for t in (0, 0.25, 0.5, 0.75)]
    )
    outline = seen.pixels(_turned(rim * place.side * drawn.span, place.yaw_rad) + place.at)
    outline = outline[np.isfinite(outline).all(axis=1)]
    left, top = np.maximum(np.floor(outline.min(axis=0)).astype(int) - 2, 0)
    right, bottom = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 3, [WIDTH, HEIGHT])
    if right - left < 2 or bottom - top < 2:
        return
    times = 4 if place.side_px < 60 else 2
    points = seen.points[top:bottom, left:right] - place.at.astype(np.float32)
    fine = cv2.resize(points, None, fx=times, fy=times, interpolation=cv2.INTER_LINEAR)
    c, s = math.cos(place.yaw_rad), math.sin(place.yaw_rad)
    per = 1.0 / (place.side * drawn.span)
    along = fine[..., 0] * np.float32(c * per) + fine[..., 1] * np.float32(s * per)
    across = fine[..., 1] * np.float32(c * per) - fine[..., 0] * np.float32(s * per)
    step = PRINT_PX / (drawn.span * place.side_px * times)
    level = drawn.levels[int(np.clip(math.log2(max(step, 1.0)), 0, len(drawn.levels) - 1))]
    n = np.float32(level.shape[0])
    half = np.float32(0.5)
    x, y = (across + half) * n - half, (half - along) * n - half
    looked = cv2.remap(level, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0, 0, 0))
    looked = cv2.resize(looked, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
    share = np.asarray(looked, np.float32) * np.float32(1 / 255)
    part = picture[top:bottom, left:right]
    ahead = ~seen.sky[top:bottom, left:right]
    part += ahead * (share[..., 0] - share[..., 1] * part)


# --------------------------------------------------------------------------------------------------- light, sensor
@dataclass(frozen=True, slots=True)
class Light:
    """Light and sensor of one frame.

    Attributes:
        field: (HEIGHT, WIDTH) float32 factor on reflectance.
        glare: (HEIGHT, WIDTH) float32 added light.
        white: Grey level of reflectance 1 (over 255: overexposed).
        gamma: Level is (light)^(1 / gamma).
        blur_px: Deviation of the lens's blur.
        motion_px: Length of the motion blur.
        motion_rad: Its direction.
        noise: Deviation in grey levels.
        jpeg: Quality, or None.
    """

    field: Plane
    glare: Plane
    white: float
    gamma: float
    blur_px: float
    motion_px: float
    motion_rad: float
    noise: float
    jpeg: int | None


def light(source: np.random.Generator, keep_clear: Sequence[tuple[float, float, float]]) -> Light:
    """Light at random. Glare keeps off the circles (u, v, radius): what it hides can tell nothing from nothing."""
    small = (HEIGHT // 4, WIDTH // 4)
    v, u = np.mgrid[0 : small[0], 0 : small[1]].astype(np.float32)
    slope = source.normal(0, 0.35, 2)
    coarse = np.exp(slope[0] * (u / small[1] - 0.5) + slope[1] * (v / small[0] - 0.5))
    radius2 = ((u - small[1] / 2) / small[1]) ** 2 + ((v - small[0] / 2) / small[0]) ** 2
    coarse *= 1 - source.uniform(0, 0.9) * radius2
    field = np.asarray(cv2.resize(coarse, (WIDTH, HEIGHT)), np.float32)
    shadows = int(source.choice([0, 1, 2, 3], p=[0.5, 0.25, 0.15, 0.1]))
    if shadows:
        lit = np.ones((HEIGHT, WIDTH), np.float32)
        for _ in range(shadows):
            at, turn = source.uniform((0, 0), (WIDTH, HEIGHT)), source.uniform(0, math.tau)
            half = np.array([1200.0, float(source.choice([6, 20, 60, 300, 600]))])
            corners = _turned(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half, turn) + at
            cv2.fillPoly(
                lit, [np.round(corners * 16).astype(np.int32)], float(source.uniform(0.15, 0.6)), cv2.LINE_8, 4
            )
        field *= np.asarray(cv2.GaussianBlur(lit, (0, 0), float(source.choice([0.8, 2, 5]))), np.float32)
    glare = np.zeros((HEIGHT, WIDTH), np.float32)
    if source.random() < 0.15:
        at, size = source.uniform((0, 0), (WIDTH, HEIGHT)), float(source.uniform(15, 90))
        if all(math.hypot(at[0] - cu, at[1] - cv) > r + 3 * size for cu, cv, r in keep_clear):
            blob = np.exp(-((u - at[0] / 4) ** 2 + (v - at[1] / 4) ** 2) / (2 * (size / 4) ** 2))
            glare = np.asarray(cv2.resize(blob.astype(np.float32), (WIDTH, HEIGHT)), np.float32)
            glare *= np.float32(source.uniform(0.3, 2.0))
    dusk = source.random() < 0.15
    white = float(
        np.exp(source.uniform(math.log(25), math.log(70)) if dusk else source.uniform(math.log(80), math.log(450)))
    )
    blurred = source.random()
    return Light(
        field=field,
        glare=glare,
        white=white,
        gamma=float(source.choice([1.0, 1.0, 1.6, 2.2])),
        blur_px=float(source.uniform(0.4, 0.9) if blurred < 0.75 else source.uniform(0.9, 2.2)),
        motion_px=float(source.choice([0.0, source.uniform(1, 8)], p=[0.8, 0.2])),
        motion_rad=float(source.uniform(0, math.pi)),
        noise=float(min(source.choice([0.5, 1.5, 3.0, 6.0]), white / 12)),
        jpeg=int(source.integers(35, 95)) if source.random() < 0.2 else None,
    )


@lru_cache(maxsize=1)
def _noise_field() -> Plane:
    return np.random.default_rng(99).standard_normal((2 * HEIGHT, 2 * WIDTH)).astype(np.float32)


def _motion_kernel(length: float, turn: float) -> Plane:
    n = 2 * math.ceil(length / 2 + 1) + 1
    kernel = np.zeros((n * 8, n * 8), np.float32)
    half = np.array([math.cos(turn), math.sin(turn)]) * length * 4
    middle = n * 4
    a, b = (tuple(round(middle + k * float(h)) for h in half) for k in (-1, 1))
    cv2.line(kernel, a, b, 1.0, 8)
    small = cv2.resize(kernel, (n, n), interpolation=cv2.INTER_AREA)
    return np.asarray(small / small.sum(), np.float32)


def expose(picture: Plane, lit: Light) -> Plane:
    """(HEIGHT, WIDTH) grey levels of a picture of reflectance, without the noise."""
    seen = picture * lit.field + lit.glare
    seen = np.asarray(cv2.GaussianBlur(seen, (0, 0), lit.blur_px), np.float32)
    if lit.motion_px > 0:
        seen = np.asarray(cv2.filter2D(seen, -1, _motion_kernel(lit.motion_px, lit.motion_rad)), np.float32)
    levels = np.asarray(seen, np.float32) * np.float32(lit.white / 255)
    if lit.gamma != 1.0:
        levels = np.asarray(cv2.pow(np.maximum(levels, 0), 1 / lit.gamma), np.float32)
    return np.asarray(levels * np.float32(255), np.float32)


def sense(levels: Plane, lit: Light, source: np.random.Generator, shift: tuple[float, float] = (0.0, 0.0)) -> Grey:
    """The frame: noise, whole grey levels, the codec. `shift` moves it by some pixels, for the next of a sequence."""
    if shift != (0.0, 0.0):
        matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
        moved = cv2.warpAffine(levels, matrix, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
        levels = np.asarray(moved, np.float32)
    row, column = source.integers(0, HEIGHT), source.integers(0, WIDTH)
    grain = _noise_field()[row : row + HEIGHT, column : column + WIDTH]
    image = np.clip(levels + grain * np.float32(lit.noise) + np.float32(0.5), 0, 255).astype(np.uint8)
    if lit.jpeg is not None:
        _, coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, lit.jpeg])
        image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)
    return image
