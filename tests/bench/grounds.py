"""What the board lies on: lawn, asphalt, concrete, gravel and water as tiles of relative albedo, and litter on them.

Each ground is a fine tile and a coarse one of unlike span, multiplied, so that no repetition shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from optics import Array
from texture import Texture

GROUNDS = ("lawn", "asphalt", "concrete", "gravel", "water")


@dataclass(frozen=True)
class Ground:
    """A kind of ground.

    Attributes:
        fine: Relative albedo, about 1.
        coarse: The same over metres.
    """

    fine: Texture
    coarse: Texture

    def sample(self, x: Array, y: Array, footprint: Array) -> Array:
        """(h, w) float32 relative albedo."""
        near = self.fine.sample(x, y, footprint) * self.coarse.sample(x, y, footprint)
        # The same clouds once more, turned by 3:4:5 and five times as large: no tile is seen twice in a wide view.
        a, b, c = np.float32(0.12), np.float32(0.16), np.float32(0.2)
        far = self.coarse.sample(a * x - b * y, b * x + a * y, footprint * c)
        return np.asarray(near * far)


def noise(rng: np.random.Generator, size: int, slope: float, longest: float = 1.0, stretch: float = 1.0) -> Array:
    """(size, size) float32 noise that tiles, of deviation 1: amplitude falls with frequency^slope.

    Args:
        rng: Where it comes from.
        size: Of the tile.
        slope: 0 is white, 1 is pink, 2 is clouds.
        longest: Longest wave, in tiles.
        stretch: Waves along y are this much longer than along x.
    """
    fx = np.fft.rfftfreq(size)[None, :] * size
    fy = np.fft.fftfreq(size)[:, None] * size * stretch
    f = np.hypot(fx, fy)
    f[0, 0] = 1.0
    gain = np.where(f >= 1.0 / longest, f**-slope, 0.0)
    gain[0, 0] = 0.0
    white = rng.standard_normal((size, size // 2 + 1)) + 1j * rng.standard_normal((size, size // 2 + 1))
    field = np.fft.irfft2(white * gain, s=(size, size))
    return np.asarray(field / field.std(), np.float32)


def _wrapped(size: int, x: float, y: float, reach: float) -> list[tuple[int, int]]:
    """Shifts by whole tiles under which something at (x, y) of this reach shows in the tile."""
    xs = [0] + ([size] if x < reach else []) + ([-size] if x > size - reach else [])
    ys = [0] + ([size] if y < reach else []) + ([-size] if y > size - reach else [])
    return [(a, b) for a in xs for b in ys]


def _blades(rng: np.random.Generator, size: int, count: int) -> Array:
    tile: Array = np.full((size, size), 0.35, np.float32)
    for k in range(count):
        x, y = rng.uniform(0, size, 2)
        angle, length = rng.uniform(0, 2 * math.pi), rng.uniform(0.015, 0.06) * size
        dx, dy = length * math.cos(angle), length * math.sin(angle)
        bright = (0.4 + 0.9 * k / count) * float(rng.lognormal(0, 0.35))
        thick = int(rng.integers(1, 4))
        for sx, sy in _wrapped(size, x, y, length + 3):
            a, b = (round((x + sx) * 16), round((y + sy) * 16)), (round((x + sx + dx) * 16), round((y + sy + dy) * 16))
            cv2.line(tile, a, b, bright, thick, cv2.LINE_AA, 4)
    return tile


def _stones(rng: np.random.Generator, size: int, count: int, sizes: tuple[float, float], contrast: float) -> Array:
    """Ellipses with a lit and a dark side, later ones on top of earlier ones."""
    tile: Array = np.full((size, size), 0.3, np.float32)
    light = rng.uniform(0, 2 * math.pi)
    for _ in range(count):
        x, y = rng.uniform(0, size, 2)
        radius = float(np.exp(rng.uniform(math.log(sizes[0]), math.log(sizes[1])))) * size
        axes = (max(radius, 1.0), max(radius * rng.uniform(0.5, 1.0), 1.0))
        turn, bright = rng.uniform(0, 180), float(rng.lognormal(0, contrast))
        for sx, sy in _wrapped(size, x, y, radius * 1.4):
            for shift, scale, level in ((0.25, 1.0, 0.25), (0.0, 1.0, bright), (-0.25, 0.6, bright * 1.25)):
                cx, cy = x + sx + shift * radius * math.cos(light), y + sy + shift * radius * math.sin(light)
                centre = (round(cx * 16), round(cy * 16))
                ax = (round(axes[0] * scale * 16), round(axes[1] * scale * 16))
                cv2.ellipse(tile, centre, ax, turn, 0, 360, level, -1, cv2.LINE_AA, 4)
    return tile


def _cracks(rng: np.random.Generator, tile: Array, count: int, depth: float) -> None:
    size = tile.shape[0]
    for _ in range(count):
        at, angle = rng.uniform(0, size, 2), rng.uniform(0, 2 * math.pi)
        for _ in range(int(rng.integers(10, 60))):
            angle += rng.normal(0, 0.4)
            to = at + 8 * np.array([math.cos(angle), math.sin(angle)])
            cv2.line(tile, (round(at[0]), round(at[1])), (round(to[0]), round(to[1])), depth, 1, cv2.LINE_AA)
            at = to


def _even(tile: Array) -> Array:
    return np.asarray(np.maximum(tile, 0.02) / tile.mean(), np.float32)


@lru_cache(maxsize=64)
def ground(kind: str, variant: int) -> Ground:
    """One of the grounds.

    Args:
        kind: Of GROUNDS.
        variant: Seed of its textures.
    """
    rng = np.random.default_rng([GROUNDS.index(kind), variant])
    soft = noise(rng, 512, 1.4)
    if kind == "lawn":
        fine = _blades(rng, 1024, 9000)
        coarse = 1 + 0.16 * soft + 0.06 * noise(rng, 512, 0.5)
        return Ground(Texture(_even(fine), 1.3, True), Texture(_even(coarse), 9.7, True))
    if kind == "asphalt":
        fine = _stones(rng, 1024, 14000, (0.002, 0.007), 0.3) + 0.15 * noise(rng, 1024, 0.2)
        coarse = 1 + 0.08 * soft
        _cracks(rng, coarse, int(rng.integers(0, 8)), 0.55)
        return Ground(Texture(_even(fine), 1.1, True), Texture(_even(coarse), 7.3, True))
    if kind == "concrete":
        fine = 1 + 0.04 * noise(rng, 1024, 0.4) + 0.05 * noise(rng, 1024, 1.2)
        for _ in range(400):
            at = rng.integers(0, 1024, 2)
            cv2.circle(fine, (int(at[0]), int(at[1])), int(rng.integers(1, 3)), float(rng.uniform(0.5, 0.8)), -1)
        coarse = 1 + 0.09 * soft
        slabs = int(rng.integers(1, 4))
        for k in range(slabs):
            joint = k * 512 // slabs
            coarse[joint : joint + 2] = coarse[:, joint : joint + 2] = 0.45
        _cracks(rng, coarse, int(rng.integers(0, 5)), 0.6)
        return Ground(Texture(_even(fine), 0.9, True), Texture(_even(coarse), 5.9, True))
    if kind == "gravel":
        fine = _stones(rng, 1024, 6000, (0.006, 0.03), 0.35) * (1 + 0.1 * noise(rng, 1024, 0.3))
        coarse = 1 + 0.12 * soft
        return Ground(Texture(_even(fine), 1.2, True), Texture(_even(coarse), 8.9, True))
    ripples = noise(rng, 1024, 1.5, 0.2, 1.6) + 0.5 * noise(rng, 1024, 1.2, 0.1)
    fine = np.exp(0.45 * ripples) + 4.0 * np.clip(ripples - 2.0, 0, 1.5)
    coarse = np.exp(0.3 * noise(rng, 512, 1.6, 0.3, 2.0))
    return Ground(Texture(_even(fine), 2.3, True), Texture(_even(coarse), 13.0, True))


@lru_cache
def _grain(size: int) -> Array:
    return np.asarray(1 + 0.06 * noise(np.random.default_rng(1), size, 0.6))


@lru_cache(maxsize=4)
def litter(seed: int, span: float, keep_clear: float, count: int) -> Texture:
    """Things that lie about the board: rectangles, frames, stripes, stones, leaves, cables.

    Args:
        seed: Of where and what they are.
        span: Side of the strewn square, in metres.
        keep_clear: They keep this far from the middle of the board, in metres, save for cables and stripes.
        count: How many.

    Returns:
        A texture of two channels, alpha and alpha times albedo, float32.
    """
    rng = np.random.default_rng(seed)
    size = 1024
    per_m = size / span
    alpha: Array = np.zeros((size, size), np.float32)
    colour: Array = np.zeros((size, size), np.float32)

    def fill(points: Array, level: float) -> None:
        ring = np.round((points * per_m + size / 2) * 16).astype(np.int32)
        cv2.fillPoly(alpha, [ring], 1.0, cv2.LINE_AA, 4)
        cv2.fillPoly(colour, [ring], level, cv2.LINE_AA, 4)

    def box(at: Array, half: Array, turn: float) -> Array:
        c, s = math.cos(turn), math.sin(turn)
        return np.asarray(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half @ np.array([[c, s], [-s, c]]) + at)

    for _ in range(count):
        kind = rng.choice(["rectangle", "frame", "stripes", "stone", "leaf", "cable", "square"])
        while True:
            at = rng.uniform(-span / 2, span / 2, 2)
            if math.hypot(*at) > keep_clear or kind in ("cable", "stripes"):
                break
        turn = rng.uniform(0, 2 * math.pi)
        level = float(rng.choice([rng.uniform(0.03, 0.1), rng.uniform(0.1, 0.5), rng.uniform(0.6, 0.9)]))
        extent = float(np.exp(rng.uniform(math.log(0.02), math.log(0.12)))) * span
        if kind == "rectangle":
            fill(box(at, np.array([extent, extent * rng.uniform(0.2, 1.0)]) / 2, turn), level)
        elif kind in ("frame", "square"):
            inner = 0.05 if level > 0.4 else 0.8
            for k, scale in enumerate((1.0, rng.uniform(0.55, 0.85), rng.uniform(0.2, 0.5))[: 2 + (kind == "square")]):
                fill(box(at, np.full(2, extent * scale / 2), turn), inner if k % 2 else level)
        elif kind == "stripes":
            along = np.array([math.cos(turn), math.sin(turn)])
            for k in range(int(rng.integers(1, 6))):
                place = at + along * k * extent * 0.8
                fill(box(place, np.array([extent * 0.18, span * rng.uniform(0.1, 0.6)]), turn), level)
        elif kind in ("stone", "leaf"):
            angles = np.linspace(0, 2 * math.pi, 24, endpoint=False)
            squeeze = rng.uniform(0.25, 0.45) if kind == "leaf" else rng.uniform(0.6, 1.0)
            ring = np.column_stack([np.cos(angles), squeeze * np.sin(angles) * (1 + 0.2 * rng.standard_normal(24))])
            c, s = math.cos(turn), math.sin(turn)
            fill(at + 0.5 * extent * ring @ np.array([[c, s], [-s, c]]), level)
        else:
            steps = np.cumsum(rng.normal(0, 0.25, 40)) + turn
            line = at + np.cumsum(np.column_stack([np.cos(steps), np.sin(steps)]) * span * 0.03, axis=0)
            ring = np.round((line * per_m + size / 2) * 16).astype(np.int32)
            thick = max(1, round(rng.uniform(0.006, 0.02) * per_m))
            cv2.polylines(alpha, [ring], False, 1.0, thick, cv2.LINE_AA, 4)
            cv2.polylines(colour, [ring], False, level, thick, cv2.LINE_AA, 4)
    colour *= _grain(size)
    return Texture(np.stack([alpha, np.clip(colour, 0, 1)], axis=-1), span, wraps=False)
