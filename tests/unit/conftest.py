"""A small renderer of the landmark, written from geometry for the tests alone: the second opinion on the application.

It shares with the application the drawing of the landmark (polygons in metres) and nothing else: lens formulas, the
sampling and the ground are its own. Every pixel is a ray that is cast at the pad's plane; pixels near an edge are cast
six by six times.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from app.config import LensConfig
from app.landmark import Landmark, paper_landmark

F64 = NDArray[np.float64]
Polygon = tuple[F64, float]
"""Convex polygon (n, 2) forward, right, metres, and its grey level."""

BLACK, WHITE = 25.0, 215.0
SUB = 6


@dataclass(frozen=True)
class TestLens:
    """A lens by its formula: pixel -> ray, for ray casting."""

    __test__ = False
    model: str
    f: float
    width: int = 640
    height: int = 480
    cx: float = 319.5
    cy: float = 239.5
    k: tuple[float, ...] = ()

    def cast(self, u: F64, v: F64) -> F64:
        """Rays (..., 3), not normalised, of pixels; zero where the lens sees nothing."""
        x, y = (u - self.cx) / self.f, (v - self.cy) / self.f
        r = np.hypot(x, y)
        if self.model == "pinhole":
            if self.k:
                grid = np.linspace(0.0, 1.5, 6001)
                k1, k2 = self.k[0], self.k[1]
                assert self.k[2] == self.k[3] == 0.0, "the test lens has no tangential part"
                scale = np.interp(r, grid * (1 + k1 * grid**2 + k2 * grid**4), grid) / np.maximum(r, 1e-12)
                scale = np.where(r < 1e-9, 1.0, scale)
                x, y = x * scale, y * scale
            return np.stack([x, y, np.ones_like(x)], axis=-1)
        theta = r
        if self.k:
            grid = np.linspace(0.0, 1.7, 6001)
            bent = grid * (1 + sum(k * grid ** (2 * i + 2) for i, k in enumerate(self.k)))
            theta = np.interp(r, bent, grid)
        s = np.where(r < 1e-9, 1.0, np.sin(theta) / np.maximum(r, 1e-12))
        ray = np.stack([x * s, y * s, np.cos(theta)], axis=-1)
        ray[theta > 1.66] = 0.0
        return ray

    def project(self, points: F64) -> F64:
        """(n, 2) pixels of points (n, 3) in front of a lens without distortion, by the textbook."""
        assert not self.k
        x, y, z = points.T
        rho = np.hypot(x, y)
        if self.model == "pinhole":
            radius = rho / z
        else:
            radius = np.arctan2(rho, z)
        scale = np.where(rho > 0, radius / np.where(rho > 0, rho, 1.0), 1.0 / z) * self.f
        return np.column_stack([self.cx + x * scale, self.cy + y * scale])

    @property
    def config(self) -> LensConfig:
        """The same lens as a camera file has it."""
        return LensConfig(
            model=self.model,
            width_px=self.width,
            height_px=self.height,
            fx_px=self.f,
            fy_px=self.f,
            cx_px=self.cx,
            cy_px=self.cy,
            distortion=self.k,
        )


FISHEYE = TestLens("equidistant", 215.0)
PINHOLE = TestLens("pinhole", 495.0)


@dataclass(frozen=True)
class View:
    """Where the camera is: rotation cam_from_pad (3, 3) and the pad's origin in cam (3,)."""

    rotation: F64
    t: F64


def look_down(
    height_m: float,
    *,
    forward_m: float = 0.0,
    right_m: float = 0.0,
    pad_yaw_deg: float = 0.0,
    roll_deg: float = 0.0,
    pitch_deg: float = 0.0,
) -> View:
    """A camera under a vehicle above a level pad.

    The pad's origin lies forward_m and right_m of the point below the camera along the vehicle's level axes, its
    heading pad_yaw_deg clockwise of the vehicle's; then the vehicle rolls (right side down) and pitches (nose up).
    """

    def about(axis: int, deg: float) -> F64:
        c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
        m = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        m[i, i], m[i, j], m[j, i], m[j, j] = c, -s, s, c
        return m

    level_from_pad = about(2, pad_yaw_deg)
    level_from_body = about(1, pitch_deg) @ about(0, roll_deg)
    cam_from_body = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    cam_from_level = cam_from_body @ level_from_body.T
    return View(cam_from_level @ level_from_pad, cam_from_level @ np.array([forward_m, right_m, height_m]))


def polygons_of(landmark: Landmark, *, inverted: bool = False) -> list[Polygon]:
    """Quiet zone and contours in painter's order."""
    black, white = (WHITE, BLACK) if inverted else (BLACK, WHITE)
    q = landmark.quiet_zone_m / 2
    zone = np.array([[q, -q], [q, q], [-q, q], [-q, -q]])
    return [(zone, white), *((c.corners_m, black if c.black else white) for c in landmark.contours)]


def _inside(poly: F64, p: F64) -> F64:
    """Signed distance (negative inside) of points (..., 2) to a convex polygon, exact near its sides."""
    edge = np.roll(poly, -1, axis=0) - poly
    area2 = float(np.sum(poly[:, 0] * np.roll(poly[:, 1], -1) - np.roll(poly[:, 0], -1) * poly[:, 1]))
    n = np.column_stack([edge[:, 1], -edge[:, 0]]) * math.copysign(1.0, area2)
    n /= np.linalg.norm(n, axis=1)[:, None]
    d = np.full(p.shape[:-1], -np.inf)
    for k in range(len(poly)):
        d = np.maximum(d, (p[..., 0] - poly[k, 0]) * n[k, 0] + (p[..., 1] - poly[k, 1]) * n[k, 1])
    return d


def _lawn(seed: int = 7, size: int = 1024) -> NDArray[np.uint8]:
    """A texture with a 1/f spectrum and blades; it tiles."""
    rng = np.random.default_rng(seed)
    fy, fx = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size), indexing="ij")
    spectrum = np.fft.fft2(rng.standard_normal((size, size))) / np.maximum(np.hypot(fy, fx), 2.0 / size) ** 0.9
    noise = np.real(np.fft.ifft2(spectrum))
    noise = (noise - noise.mean()) / noise.std()
    image = np.clip(95.0 + 22.0 * noise, 0, 255).astype(np.uint8)
    for _ in range(size * size // 60):
        x, y = rng.integers(0, size, 2)
        a, length = rng.uniform(0, math.tau), rng.uniform(5, 16)
        end = (int(x + length * math.cos(a)), int(y + length * math.sin(a)))
        cv2.line(image, (int(x), int(y)), end, float(np.clip(rng.normal(100, 45), 5, 235)), 1, cv2.LINE_AA)
    return image


@dataclass
class Renderer:
    """Draws what the camera sees."""

    texel_m: float = 0.003
    _pyramid: list[NDArray[np.uint8]] = field(default_factory=list)
    _rays: dict[TestLens, tuple[F64, F64, F64]] = field(default_factory=dict)

    def _ground(self, p: F64, footprint_m: float) -> F64:
        if not self._pyramid:
            self._pyramid = [_lawn()]
            while self._pyramid[-1].shape[0] > 64:
                half = cv2.pyrDown(self._pyramid[-1], borderType=cv2.BORDER_REFLECT).astype(np.float64)
                # Grass looks as rough from afar as from near: the contrast that averaging takes is put back.
                half = 95.0 + (half - half.mean()) * 26.0 / half.std()
                self._pyramid.append(np.clip(half, 0, 255).astype(np.uint8))
        level = int(np.clip(round(math.log2(max(footprint_m / self.texel_m, 1.0))), 0, len(self._pyramid) - 1))
        texture = self._pyramid[level]
        q = np.mod((p / (self.texel_m * 2**level) + 200.0).astype(np.float32), np.float32(texture.shape[0]))
        drawn = cv2.remap(texture, q[..., 1], q[..., 0], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return drawn.astype(np.float64)

    @staticmethod
    def _paint(
        image: F64,
        polygons: Sequence[Polygon],
        box: tuple[slice, slice],
        points: F64,
        on_plane: NDArray[np.bool_],
        hit: Callable[[F64, F64], tuple[F64, NDArray[np.bool_]]],
    ) -> None:
        """Polygons into the part of the image that they lie in; pixels on an edge are cast SUB x SUB times."""
        part, p, down = image[box], points[box], on_plane[box]
        local = np.zeros(part.shape)
        local[:, 1:] += np.linalg.norm(np.diff(p, axis=1), axis=-1)
        local[1:] += np.linalg.norm(np.diff(p, axis=0), axis=-1)
        ground = part.copy()
        near = np.zeros(part.shape, dtype=bool)
        for poly, grey in polygons:
            d = _inside(poly, p)
            part[down & (d < 0)] = grey
            near |= down & (np.abs(d) < 1.3 * local)
        rows, cols = np.nonzero(near)
        step = (np.arange(SUB) + 0.5) / SUB - 0.5
        du, dv = np.meshgrid(step, step)
        fine, _ = hit(cols[:, None] + box[1].start + du.ravel(), rows[:, None] + box[0].start + dv.ravel())
        value = np.repeat(ground[near][:, None], SUB * SUB, axis=1)
        for poly, grey in polygons:
            value[_inside(poly, fine) < 0] = grey
        part[rows, cols] = value.mean(axis=1)

    def __call__(
        self,
        view: View,
        *,
        polygons: Sequence[Polygon],
        lens: TestLens = FISHEYE,
        lawn: bool = True,
        gain: float = 1.0,
        blur_px: float = 0.6,
        noise: float = 2.0,
        seed: int = 0,
        light: Callable[[F64], F64] | None = None,
    ) -> NDArray[np.uint8]:
        """(height, width) grey image. light: factor by (forward, right) on the pad's plane, for shadows."""
        rotation, t = view.rotation, view.t
        centre = -rotation.T @ t

        def hit(u: F64, v: F64, cast: F64 | None = None) -> tuple[F64, NDArray[np.bool_]]:
            ray = (lens.cast(u, v) if cast is None else cast) @ rotation
            down = ray[..., 2] > 1e-3
            s = np.where(down, -centre[2] / np.where(down, ray[..., 2], 1.0), 0.0)
            return centre[:2] + ray[..., :2] * s[..., None], down

        if lens not in self._rays:
            u, v = np.meshgrid(np.arange(lens.width, dtype=np.float64), np.arange(lens.height, dtype=np.float64))
            self._rays[lens] = (u, v, lens.cast(u, v))
        u, v, cast = self._rays[lens]
        p, down = hit(u, v, cast)
        footprint = float(np.linalg.norm(t)) / lens.f
        image = self._ground(p, footprint) if lawn else np.full(u.shape, 110.0)
        reach = max((float(np.abs(poly).max()) for poly, _ in polygons), default=0.0) * 1.1 + 3 * footprint
        rows, cols = np.nonzero(down & (np.abs(p) < reach).all(axis=-1))
        if len(rows):
            self._paint(
                image, polygons, (slice(rows.min(), rows.max() + 1), slice(cols.min(), cols.max() + 1)), p, down, hit
            )
        image[~down] = 160.0
        if light is not None:
            image = image * light(p)
        image = image * gain
        if blur_px > 0:
            image = cv2.GaussianBlur(image, (0, 0), blur_px)
        image = image + np.random.default_rng(seed).normal(0.0, noise, image.shape)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Scene:
    """What the tests draw with and compare to."""

    render: Renderer
    landmark: Landmark
    fisheye: TestLens = FISHEYE
    pinhole: TestLens = PINHOLE

    def view(self, height_m: float, **where: float) -> View:
        """See look_down."""
        return look_down(height_m, **where)

    def polygons(self, landmark: Landmark | None = None, *, inverted: bool = False) -> list[Polygon]:
        """See polygons_of."""
        return polygons_of(landmark or self.landmark, inverted=inverted)

    def draw(self, view: View, *, landmark: Landmark | None = None, **options: object) -> NDArray[np.uint8]:
        """The paper's landmark, or another, or `polygons`."""
        options.setdefault("polygons", polygons_of(landmark or self.landmark))
        return self.render(view, **options)

    def corners_px(self, view: View, index: int, lens: TestLens, landmark: Landmark | None = None) -> F64:
        """(n, 2) where a contour's corners truly are."""
        corners = (landmark or self.landmark).contours[index].corners_m
        return lens.project(np.column_stack([corners, np.zeros(len(corners))]) @ view.rotation.T + view.t)


@pytest.fixture(scope="session")
def scene() -> Scene:
    """The renderer (its lawn is made once) with the paper's landmark and two lenses."""
    return Scene(Renderer(), paper_landmark())
