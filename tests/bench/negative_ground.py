"""Grounds that hold no landmark, as tiles cheap to look up: what the negatives lie on, or are.

Contrast is drawn as hard as it comes in the world, and edges as many: these are to tempt a detector, not to please.
The benchmark's own grounds (grounds.py) are finer and slower; ten thousand frames need these.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float32]
SIZE = 1024
LEVELS = 7
VARIANTS = 4
"""Tiles of each kind; the last are kept for the unseen part."""


@dataclass(frozen=True, slots=True)
class Tile:
    """A tile and its halvings in one sheet.

    Attributes:
        sheet: (SIZE, 3 SIZE / 2) uint8.
        rows: First row of each level in the sheet.
        columns: First column of each.
    """

    sheet: NDArray[np.uint8]
    rows: Plane
    columns: Plane

    def look_up(self, right: Plane, back: Plane, texels_per_px: Plane) -> Plane:
        """(h, w) 0..1 at points given in texels, each from the halving nearest to the pixel's size."""
        level = np.clip(np.log2(texels_per_px) + np.float32(0.5), 0, LEVELS - 1).astype(np.int32)
        scale = np.exp2(-level.astype(np.float32))
        size = np.float32(SIZE)
        x = (right - np.floor(right / size) * size) * scale
        y = (back - np.floor(back / size) * size) * scale
        picture = cv2.remap(self.sheet, x + self.columns[level], y + self.rows[level], cv2.INTER_LINEAR)
        return np.asarray(picture, np.float32) * np.float32(1 / 255)


def _sheet(picture: Plane) -> Tile:
    picture = (picture - picture.min()) / max(float(np.ptp(picture)), 1e-6)
    level = np.asarray(picture * 254 + 0.5, np.uint8)
    sheet = np.zeros((SIZE, SIZE + SIZE // 2), np.uint8)
    rows, columns, row = [0], [0], 0
    sheet[:, :SIZE] = level
    for _ in range(1, LEVELS):
        level = np.asarray(cv2.resize(level, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
        n = level.shape[0]
        sheet[row : row + n, SIZE : SIZE + n] = level
        rows.append(row)
        columns.append(SIZE)
        row += n
    return Tile(sheet, np.array(rows, np.float32), np.array(columns, np.float32))


Maker = Callable[[np.random.Generator], Plane]
GROUNDS: dict[str, Maker] = {}


def _ground(name: str) -> Callable[[Maker], Maker]:
    def enter(maker: Maker) -> Maker:
        GROUNDS[name] = maker
        return maker

    return enter


@lru_cache(maxsize=64)
def tile(name: str, variant: int) -> Tile:
    """A ground of GROUNDS; the same for the same variant."""
    return _sheet(GROUNDS[name](np.random.default_rng((list(GROUNDS).index(name), variant, 5))))


def clouds(source: np.random.Generator, slope: float, stretch: float = 1.0) -> Plane:
    """Noise that tiles, of deviation 1, its amplitude falling with frequency^slope."""
    fx = np.fft.rfftfreq(SIZE)[None, :] * SIZE
    fy = np.fft.fftfreq(SIZE)[:, None] * SIZE * stretch
    frequency = np.hypot(fx, fy)
    frequency[0, 0] = np.inf
    spectrum = source.standard_normal((SIZE, SIZE // 2 + 1)) * np.exp(
        2j * math.pi * source.random((SIZE, SIZE // 2 + 1))
    )
    field = np.fft.irfft2(spectrum * frequency**-slope, s=(SIZE, SIZE))
    return np.asarray(field / field.std(), np.float32)


def _polygon(canvas: Plane, points: NDArray[np.float64], grey: float) -> None:
    cv2.fillPoly(canvas, [np.round(points * 16).astype(np.int32)], grey, cv2.LINE_AA, 4)


def _turned(points: NDArray[np.float64], turn: float) -> NDArray[np.float64]:
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


@_ground("lawn")
def _lawn(source: np.random.Generator) -> Plane:
    """Blades in hard sun: near black between them, near white on them."""
    canvas: Plane = np.full((SIZE, SIZE), 0.12, np.float32)
    for k in range(9000):
        at, turn = source.uniform(0, SIZE, 2), source.uniform(0, math.tau)
        to = at + source.uniform(10, 45) * np.array([math.cos(turn), math.sin(turn)])
        grey = float(np.clip((0.15 + 0.5 * k / 9000) * source.lognormal(0, 0.5), 0.03, 1.0))
        cv2.line(canvas, tuple(map(int, at)), tuple(map(int, to)), grey, int(source.integers(1, 4)), cv2.LINE_AA)
    return canvas


@_ground("gravel")
def _gravel(source: np.random.Generator) -> Plane:
    canvas: Plane = np.full((SIZE, SIZE), 0.05, np.float32)
    for _ in range(5000):
        at = source.uniform(0, SIZE, 2)
        n = int(source.integers(4, 9))
        angle = np.sort(source.uniform(0, math.tau, n))
        radius = float(source.uniform(5, 26)) * source.uniform(0.75, 1.0, n)
        ring = np.column_stack([np.cos(angle), np.sin(angle)]) * radius[:, None] + at
        grey = float(np.clip(source.lognormal(-0.8, 0.4), 0.1, 1.0))
        _polygon(canvas, ring + 2.0, 0.06)
        _polygon(canvas, ring, grey)
    return canvas + 0.03 * clouds(source, 0.3)


@_ground("asphalt")
def _asphalt(source: np.random.Generator) -> Plane:
    grain = cv2.GaussianBlur(source.standard_normal((SIZE, SIZE)).astype(np.float32), (0, 0), 1.6)
    canvas = 0.25 + 0.06 * grain / grain.std() + 0.03 * clouds(source, 1.2)
    for _ in range(12):
        at = source.uniform(0, SIZE, 2)
        points = at + np.cumsum(source.normal(0, 14, (60, 2)) + source.normal(0, 6, 2), axis=0)
        cv2.polylines(canvas, [points.astype(np.int32)], False, 0.05, int(source.integers(1, 5)), cv2.LINE_AA)
    return np.asarray(canvas, np.float32)


@_ground("water")
def _water(source: np.random.Generator) -> Plane:
    """Ripples with glitter."""
    ripples = clouds(source, 1.5, 1.7) + 0.4 * clouds(source, 0.9)
    return np.asarray(np.exp(0.5 * ripples) + 6.0 * np.clip(ripples - 1.8, 0, 1.0), np.float32)


@_ground("leaves")
def _leaves(source: np.random.Generator) -> Plane:
    canvas: Plane = np.full((SIZE, SIZE), 0.2, np.float32)
    for _ in range(2600):
        at, turn = source.uniform(0, SIZE, 2), source.uniform(0, math.tau)
        t = np.linspace(0, math.tau, 14, endpoint=False)
        length = float(source.uniform(10, 45))
        ring = np.column_stack([np.cos(t), source.uniform(0.25, 0.7) * np.sin(t) * (1 - 0.4 * np.cos(t))]) * length
        grey = float(np.clip(source.lognormal(-1.0, 0.7), 0.03, 1.0))
        _polygon(canvas, _turned(ring, turn) + at + 3.0, 0.04)
        _polygon(canvas, _turned(ring, turn) + at, grey)
    return canvas


@_ground("bricks")
def _bricks(source: np.random.Generator) -> Plane:
    canvas: Plane = np.full((SIZE, SIZE), float(source.choice([0.08, 0.85])), np.float32)
    wide, high = 128, 64
    for j in range(SIZE // high):
        for i in range(-1, SIZE // wide):
            x = i * wide + (j % 2) * wide // 2
            cv2.rectangle(
                canvas, (x + 4, j * high + 4), (x + wide - 5, j * high + high - 5), float(source.uniform(0.2, 0.6)), -1
            )
    return canvas + 0.03 * clouds(source, 0.5)


@_ground("paving")
def _paving(source: np.random.Generator) -> Plane:
    """Square slabs, some dark, some with a slab or a grid set in."""
    canvas: Plane = np.full((SIZE, SIZE), 0.1, np.float32)
    step = int(source.choice([64, 128]))
    for y in range(0, SIZE, step):
        for x in range(0, SIZE, step):
            grey = float(source.choice([0.15, 0.3, 0.5, 0.8]))
            cv2.rectangle(canvas, (x + 3, y + 3), (x + step - 4, y + step - 4), grey, -1)
            if source.random() < 0.3:
                inset = int(source.integers(step // 8, step // 3))
                other = float(source.choice([0.08, 0.85]))
                cv2.rectangle(canvas, (x + inset, y + inset), (x + step - inset, y + step - inset), other, -1)
    return canvas + 0.02 * clouds(source, 0.5)


@_ground("tiles")
def _tiles(source: np.random.Generator) -> Plane:
    """Black and white floor tiles: squares in squares and triangles, printed by the thousand."""
    canvas: Plane = np.full((SIZE, SIZE), 0.9, np.float32)
    step = 128
    style = int(source.integers(3))
    for y in range(0, SIZE, step):
        for x in range(0, SIZE, step):
            if style == 0:
                sides, greys = (0.9, 0.55, 0.28), (0.08, 0.9, 0.08)
                for side, grey in zip(sides, greys, strict=True):
                    inset = round(step * (1 - side) / 2)
                    cv2.rectangle(canvas, (x + inset, y + inset), (x + step - inset, y + step - inset), grey, -1)
            elif style == 1:
                corner = source.integers(4)
                points = np.delete(np.array([[0, 0], [step, 0], [step, step], [0, step]]), corner, axis=0)
                _polygon(canvas, points + np.array([x, y], np.float64), 0.1)
            elif (x // step + y // step) % 2:
                cv2.rectangle(canvas, (x, y), (x + step - 1, y + step - 1), 0.08, -1)
    return canvas


@_ground("planks")
def _planks(source: np.random.Generator) -> Plane:
    canvas = 0.5 + 0.12 * clouds(source, 1.1, 0.04)
    for x in range(0, SIZE, 128):
        canvas[:, x : x + 128] *= float(source.uniform(0.6, 1.3))
        canvas[:, x : x + 5] = 0.04
        y = int(source.integers(0, SIZE - 5))
        canvas[y : y + 5, x : x + 128] = 0.04
    return np.asarray(canvas, np.float32)


@_ground("grass-shadow")
def _grass_shadow(source: np.random.Generator) -> Plane:
    """Dappled light: the sun through leaves on grass."""
    sun = clouds(source, 1.25) > 0.2
    grain = cv2.GaussianBlur(source.standard_normal((SIZE, SIZE)).astype(np.float32), (0, 0), 1.2)
    return np.asarray(np.where(sun, 0.75, 0.15) * (1 + 0.25 * grain / grain.std()), np.float32)


@_ground("blobs")
def _blobs(source: np.random.Generator) -> Plane:
    """Two greys, a border that winds without end."""
    field = clouds(source, 1.2)
    return np.asarray(np.clip(field * 8, -1, 1), np.float32)


@_ground("white-noise")
def _white_noise(source: np.random.Generator) -> Plane:
    return np.asarray(source.standard_normal((SIZE, SIZE)).clip(-3, 3), np.float32)


@_ground("pink-noise")
def _pink_noise(source: np.random.Generator) -> Plane:
    return clouds(source, 1.0).clip(-3, 3)


@_ground("blocks")
def _blocks(source: np.random.Generator) -> Plane:
    """Random rectangles and triangles, each over the ones before."""
    canvas: Plane = np.full((SIZE, SIZE), 0.5, np.float32)
    for _ in range(700):
        at, turn = source.uniform(0, SIZE, 2), float(source.choice([0.0, source.uniform(0, math.tau)]))
        half = source.uniform(6, 70, 2)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (half if source.random() < 0.5 else half[0])
        if source.random() < 0.35:
            corners = np.delete(corners, source.integers(4), axis=0)
        _polygon(canvas, _turned(corners, turn) + at, float(source.choice([0.05, 0.95, source.random()])))
    return canvas


@_ground("nests")
def _nests(source: np.random.Generator) -> Plane:
    """Random nests of squares and triangles, black and white in turn, of random ratios, each turned in the other."""
    canvas: Plane = np.full((SIZE, SIZE), 0.9, np.float32)
    for _ in range(160):
        at, turn, side = source.uniform(40, SIZE - 40, 2), source.uniform(0, math.tau), source.uniform(30, 130)
        for k in range(int(source.integers(2, 6))):
            square = source.random() < 0.5
            count, start = (4, math.pi / 4) if square else (3, -math.pi / 2)
            angle = np.arange(count) * math.tau / count + start
            radius = side / math.sqrt(2) if square else side / math.sqrt(3) * 1.3
            ring = np.column_stack([np.cos(angle), np.sin(angle)]) * radius
            _polygon(canvas, _turned(ring, turn) + at, 0.07 if k % 2 == 0 else 0.9)
            side *= source.uniform(0.4, 0.85)
            turn += source.uniform(0.25, 0.6)  # the landmark's are parallel: these are none at any size
    return canvas


@_ground("grid")
def _grid(source: np.random.Generator) -> Plane:
    """A metal grid or a fence's shadow."""
    canvas: Plane = np.full((SIZE, SIZE), 0.8, np.float32)
    step, thick = int(source.choice([32, 64])), int(source.integers(4, 14))
    for k in range(0, SIZE, step):
        canvas[k : k + thick] = canvas[:, k : k + thick] = 0.08
    return canvas


@_ground("concrete")
def _concrete(source: np.random.Generator) -> Plane:
    canvas = 0.6 + 0.04 * clouds(source, 1.3) + 0.02 * clouds(source, 0.3)
    canvas[::256] = canvas[:, ::256] = 0.1
    for _ in range(60):
        at = source.integers(0, SIZE, 2)
        cv2.circle(canvas, (int(at[0]), int(at[1])), int(source.integers(3, 40)), float(source.uniform(0.1, 0.9)), -1)
    return np.asarray(canvas, np.float32)
