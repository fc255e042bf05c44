"""Cameras written from the textbook, boards held before them, and what they would see: the truth of these tests.

Nothing here calls the application's camera model or its fits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from app.calibration.board import Board, View

F64 = NDArray[np.float64]
SIZE = (640, 480)


@dataclass(frozen=True)
class TrueCamera:
    """A lens by its formula: Brown's for a pinhole, a polynomial of the angle for a fisheye."""

    model: str
    fx: float
    fy: float
    cx: float
    cy: float
    k: tuple[float, ...]

    @property
    def parameters(self) -> F64:
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.k])

    def project(self, points: F64) -> F64:
        """(n, 2) pixels of points (n, 3)."""
        x, y, z = points.T
        if self.model == "pinhole":
            k1, k2, p1, p2, k3 = self.k
            a, b = x / z, y / z
            r2 = a**2 + b**2
            radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
            u = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a**2)
            v = b * radial + p1 * (r2 + 2 * b**2) + 2 * p2 * a * b
        else:
            theta = np.arctan2(np.hypot(x, y), z)
            bent = theta * (1 + sum(k * theta ** (2 * i + 2) for i, k in enumerate(self.k)))
            azimuth = np.arctan2(y, x)
            u, v = bent * np.cos(azimuth), bent * np.sin(azimuth)
        return np.column_stack([self.fx * u + self.cx, self.fy * v + self.cy])


PINHOLE = TrueCamera("pinhole", 495.0, 497.0, 325.0, 236.0, (-0.30, 0.10, 0.001, -0.0005, 0.0))
FISHEYE = TrueCamera("equidistant", 215.0, 216.0, 324.0, 236.0, (0.05, -0.02, 0.004, -0.001))
BOARD = Board("chessboard", 10, 7, 0.025)


def turn(axis: F64, angle: float) -> F64:
    """(3, 3) rotation about an axis by Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def hold(
    azimuth: float, angle: float, distance: float, tilt: tuple[float, float, float], board: Board = BOARD
) -> tuple[F64, F64]:
    """Pose cam_from_board of a board that lies in a direction and faces the camera, but for a tilt about x, y, z."""
    direction = np.array([math.sin(angle) * math.cos(azimuth), math.sin(angle) * math.sin(azimuth), math.cos(angle)])
    facing = turn(np.array([-math.sin(azimuth), math.cos(azimuth), 0.0]), angle)
    rotation = facing @ turn(np.array([1.0, 0, 0]), tilt[0]) @ turn(np.array([0, 1.0, 0]), tilt[1])
    rotation = rotation @ turn(np.array([0, 0, 1.0]), tilt[2])
    middle = np.array([board.columns / 2, board.rows / 2, 0.0]) * board.square_m
    return rotation, direction * distance - rotation @ middle


def view_of(camera: TrueCamera, pose: tuple[F64, F64], name: str, noise: F64, board: Board = BOARD) -> View:
    """What a perfect finder would say of a board, but for the noise (n, 2)."""
    corners = np.array([(c, r, 0.0) for r in range(1, board.rows) for c in range(1, board.columns)], dtype=np.float64)
    corners = corners * board.square_m
    px = camera.project(corners @ pose[0].T + pose[1]) + noise
    return View(name, SIZE, np.arange(len(px)), corners, px, 0.8, float(np.linalg.norm(px[1] - px[0])))


def wave(
    camera: TrueCamera,
    count: int,
    *,
    seed: int = 1,
    noise: float = 0.1,
    inside: Callable[[F64], bool] = lambda px: True,
    tilt: float = 0.6,
) -> list[View]:
    """Views of a board that is waved before a camera, all corners in the image."""
    rng = np.random.default_rng(seed)
    near, far, widest = (0.35, 0.9, 0.55) if camera.model == "pinhole" else (0.15, 0.5, 1.3)
    views: list[View] = []
    while len(views) < count:
        tilts = tuple(rng.uniform(-tilt, tilt, 3))
        pose = hold(rng.uniform(0, math.tau), rng.uniform(0, widest), rng.uniform(near, far), tilts)
        view = view_of(camera, pose, f"view {len(views)}", rng.normal(0, noise, (54, 2)))
        low, high = view.px.min(axis=0), view.px.max(axis=0)
        if (low > 3).all() and (high < np.array(SIZE) - 4).all() and inside(view.px):
            views.append(view)
    return views


def photograph(
    camera: TrueCamera,
    pose: tuple[F64, F64],
    board: Board,
    *,
    size: tuple[int, int] = SIZE,
    blur: float = 0.6,
    noise: float = 2.0,
    pattern: NDArray[np.uint8] | None = None,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """(h, w) grey image of a board on white paper before grey: every pixel is nine rays cast at the board's plane.

    pattern: the board as an image, for what is more than black squares.
    """
    assert not any(camera.k), "rays are cast through lenses without distortion only"
    width, height = size
    rotation, t = pose
    # Only where the paper is: its outline, well filled, tells the part of the image.
    side = np.linspace(-1.0, 1.0, 21)
    edge = np.concatenate([np.column_stack([side, f * np.ones(21)]) for f in (-1.0, 1.0)])
    edge = np.concatenate([edge, edge[:, ::-1]]) * [board.columns / 2 + 1, board.rows / 2 + 1]
    edge = (edge + np.array([board.columns, board.rows]) / 2) * board.square_m
    outline = camera.project(np.column_stack([edge, np.zeros(len(edge))]) @ rotation.T + t)
    u0, v0 = np.clip(np.floor(outline.min(axis=0)).astype(int) - 1, 0, [width - 1, height - 1])
    u1, v1 = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 2, 1, [width, height])
    fine = (np.arange(3) + 0.5) / 3 - 0.5
    u, v = np.meshgrid((np.arange(u0, u1)[:, None] + fine).ravel(), (np.arange(v0, v1)[:, None] + fine).ravel())
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    r = np.hypot(x, y) + 1e-12
    if camera.model == "pinhole":
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    else:
        rays = np.stack([x / r * np.sin(r), y / r * np.sin(r), np.cos(r)], axis=-1)
    slope = rays @ rotation[:, 2]
    reach = float(rotation[:, 2] @ t) / np.where(np.abs(slope) < 1e-9, 1e-9, slope)
    on_board = ((rays * reach[..., None] - t) @ rotation)[..., :2] / board.square_m
    a, b = on_board[..., 0], on_board[..., 1]
    ahead = reach > 0
    paper = ahead & (a > -1) & (a < board.columns + 1) & (b > -1) & (b < board.rows + 1)
    inside = ahead & (a > 0) & (a < board.columns) & (b > 0) & (b < board.rows)
    image = np.where(paper, 220.0, 110.0)
    if pattern is None:
        image[inside & ((np.floor(a) + np.floor(b)) % 2 == 0)] = 25.0
    else:
        scale = pattern.shape[1] / board.columns
        row = np.clip((b * scale).astype(int), 0, pattern.shape[0] - 1)
        column = np.clip((a * scale).astype(int), 0, pattern.shape[1] - 1)
        image = np.where(inside, 25.0 + 195.0 / 255.0 * pattern[row, column], image)
    part = image.reshape(v1 - v0, 3, u1 - u0, 3).mean(axis=(1, 3))
    image = np.full((height, width), 110.0)
    image[v0:v1, u0:u1] = part
    if blur > 0:
        image = cv2.GaussianBlur(image, (0, 0), blur)
    image = image + np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Bench:
    """What the tests of calibration share."""

    pinhole: TrueCamera = PINHOLE
    fisheye: TrueCamera = FISHEYE
    straight: TrueCamera = TrueCamera("pinhole", 495.0, 495.0, 319.5, 239.5, (0.0,) * 5)
    straight_fisheye: TrueCamera = TrueCamera("equidistant", 215.0, 215.0, 319.5, 239.5, (0.0,) * 4)
    board: Board = BOARD
    size: tuple[int, int] = SIZE

    camera = staticmethod(TrueCamera)
    hold = staticmethod(hold)
    view_of = staticmethod(view_of)
    wave = staticmethod(wave)
    photograph = staticmethod(photograph)


@pytest.fixture(scope="session")
def bench() -> Bench:
    """Cameras, a board, and how to hold and see it."""
    return Bench()
