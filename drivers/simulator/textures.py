"""The ground's textures: lawn and asphalt, made from a seed, tiles that repeat without a seam.

A tile holds reflectance relative to its mean. Three tiles of different size and direction are multiplied (blades or
aggregate; patches; the lie of the land), so that no repetition shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float32]
Texels = NDArray[np.uint16]

TILE_PX = 2048
TILE_M = 2.56
"""1.25 mm a texel: finer than a pixel from 0.6 m up."""
WIDE_PX = 512
STEP = 1.0 / 4096.0
"""Of the tiles' whole numbers: 16 bits warp in two thirds of the time of floats."""
SEAM_PX = 2
"""Each tile is stored with this many of its first rows and columns again behind its last: no seam when interpolated."""
REFLECTANCE = {"lawn": 0.105, "asphalt": 0.13, "water": 0.07}
PATCH_M = 11.3
LAND_M = 137.0


@dataclass(frozen=True, slots=True)
class Ground:
    """The textures of one kind of ground.

    Attributes:
        fine: Square tiles from TILE_PX down, each 1 / sqrt 2 of the one before; all TILE_M wide; in STEPs.
        patches: Square tile, PATCH_M wide; in STEPs.
        land: Square tile, LAND_M wide; in STEPs.
        reflectance: Mean.
    """

    fine: tuple[Texels, ...]
    patches: Texels
    land: Texels
    reflectance: float


@lru_cache(maxsize=8)
def ground(kind: str, seed: int) -> Ground:
    """The ground of a kind ("lawn", "asphalt" or "water"); the same for the same seed."""
    source = np.random.default_rng((seed, 11))
    base = {"lawn": _lawn, "asphalt": _asphalt, "water": _water}[kind](source)
    base = (base / base.mean()).astype(np.float32)
    fine, k = [base], 1
    while round(TILE_PX / 2 ** (k / 2)) >= 16:
        size = round(TILE_PX / 2 ** (k / 2))
        fine.append(_shrink(base, size))
        k += 1
    patchy, hilly = {"lawn": (0.16, 0.12), "asphalt": (0.08, 0.06), "water": (0.20, 0.15)}[kind]
    patches = _clouds(source, WIDE_PX, (3.0, 9.0, 30.0), (0.5, 0.7, 1.0))
    land = _clouds(source, WIDE_PX, (4.0, 16.0, 60.0), (0.6, 0.7, 1.0))
    return Ground(
        tuple(_seamless(tile) for tile in fine),
        _seamless(np.clip(1.0 + patchy * patches, 0.4, 1.7)),
        _seamless(np.clip(1.0 + hilly * land, 0.5, 1.6)),
        REFLECTANCE[kind],
    )


def _seamless(tile: NDArray[np.floating[Any]]) -> Texels:
    """A tile in STEPs, with its first rows and columns again behind its last."""
    whole = np.round(np.clip(tile / STEP, 0, 65535)).astype(np.uint16)
    return np.pad(whole, ((0, SEAM_PX), (0, SEAM_PX)), mode="wrap")


def _shrink(tile: Plane, size: int) -> Plane:
    """A tile at a smaller size, low-passed by area so that nothing aliases."""
    return np.ascontiguousarray(cv2.resize(tile, (size, size), interpolation=cv2.INTER_AREA), dtype=np.float32)


def _clouds(source: np.random.Generator, size: int, sigmas_px: tuple[float, ...], weights: tuple[float, ...]) -> Plane:
    """Seamless noise of mean 0 and deviation 1: Gaussian noise low-passed at several scales."""
    frequency = np.fft.fftfreq(size)
    squared = frequency[:, None] ** 2 + frequency[None, :] ** 2
    total = np.zeros((size, size))
    for sigma, weight in zip(sigmas_px, weights, strict=True):
        spectrum = np.fft.fft2(source.standard_normal((size, size)))
        layer = np.fft.ifft2(spectrum * np.exp(-2.0 * np.pi**2 * sigma**2 * squared)).real
        total += weight * (layer - layer.mean()) / layer.std()
    result: Plane = (total / total.std()).astype(np.float32)
    return result


def _grain(source: np.random.Generator, sigma_px: float) -> Plane:
    """Seamless noise of mean 0 and deviation 1 for a whole tile, low-passed at one fine scale."""
    reach = math.ceil(4 * sigma_px)
    noise = np.pad(source.standard_normal((TILE_PX, TILE_PX), dtype=np.float32), reach, mode="wrap")
    blurred = cv2.GaussianBlur(noise, (0, 0), sigma_px)[reach:-reach, reach:-reach]
    result: Plane = (blurred / blurred.std()).astype(np.float32)
    return result


def _strokes(
    tile: NDArray[np.uint8], source: np.random.Generator, count: int, length_px: float, bright: tuple[int, int]
) -> None:
    """Blades of grass: short bent strokes, drawn so that they run over the tile's border to the other side."""
    size = tile.shape[0]
    start = source.uniform(0, size, (count, 2))
    angle = source.uniform(0, 2 * np.pi, count)
    length = length_px * source.uniform(0.5, 1.4, count)
    bend = source.normal(0.0, 0.35, count)
    value = source.integers(bright[0], bright[1], count)
    wide = source.integers(1, 4, count)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    turned = np.column_stack([np.cos(angle + bend), np.sin(angle + bend)])
    middle = start + 0.5 * length[:, None] * direction
    end = middle + 0.5 * length[:, None] * turned
    lines = np.round(np.stack([start, middle, end], axis=1) * 8).astype(np.int32)
    lowest, highest = lines.min(axis=(1, 2)), lines.max(axis=(1, 2))
    margin, span = 4 * 8, size * 8
    for k in range(count):
        moves = [(0, 0)]
        if lowest[k] < margin or highest[k] > span - margin:
            moves = [(dx, dy) for dx in (-span, 0, span) for dy in (-span, 0, span)]
        for move in moves:
            cv2.polylines(
                tile, [lines[k] + np.array(move, np.int32)], False, int(value[k]), int(wide[k]), cv2.LINE_AA, 3
            )


def _lawn(source: np.random.Generator) -> Plane:
    """Mown grass from above: soil, blades deep and high, clover, some daisies."""
    tile = np.full((TILE_PX, TILE_PX), 48, dtype=np.uint8)
    _strokes(tile, source, 11000, 34.0, (50, 85))
    _strokes(tile, source, 12000, 38.0, (70, 120))
    _strokes(tile, source, 9000, 36.0, (95, 165))
    _strokes(tile, source, 900, 30.0, (150, 205))
    for _ in range(140):
        x, y = (int(v) for v in source.integers(20, TILE_PX - 20, 2))
        shade = int(source.integers(70, 130))
        for k in range(3):
            a = 2.1 * k + float(source.uniform(0, 0.4))
            cv2.circle(tile, (x + int(5 * np.cos(a)), y + int(5 * np.sin(a))), 5, shade, -1, cv2.LINE_AA)
    for _ in range(9):
        x, y = (int(v) for v in source.integers(20, TILE_PX - 20, 2))
        cv2.circle(tile, (x, y), int(source.integers(6, 10)), 235, -1, cv2.LINE_AA)
        cv2.circle(tile, (x, y), 3, 190, -1, cv2.LINE_AA)
    clumps = _clouds(source, 256, (4.0, 14.0), (1.0, 1.0))
    big = cv2.resize(np.pad(clumps, 1, mode="wrap"), None, fx=8, fy=8, interpolation=cv2.INTER_LINEAR)[8:-8, 8:-8]
    result: Plane = ((tile.astype(np.float32) / 100.0) ** 1.6 * (1.0 + 0.12 * big)).astype(np.float32)
    return result


def _asphalt(source: np.random.Generator) -> Plane:
    """Worn asphalt: aggregate of several sizes in dark binder, some pale stones, hairline cracks."""
    coarse, small = _grain(source, 4.0), _grain(source, 1.6)
    tile = 1.0 + 0.20 * np.tanh(1.6 * coarse) + 0.12 * small
    pale = np.zeros((TILE_PX, TILE_PX), dtype=np.uint8)
    for _ in range(2600):
        x, y = (int(v) for v in source.integers(8, TILE_PX - 8, 2))
        axes = (int(source.integers(2, 6)), int(source.integers(2, 5)))
        cv2.ellipse(
            pale, (x, y), axes, float(source.uniform(0, 180)), 0, 360, int(source.integers(60, 255)), -1, cv2.LINE_AA
        )
    tile += 0.55 * pale.astype(np.float32) / 255.0
    crack = np.zeros((TILE_PX, TILE_PX), dtype=np.uint8)
    for _ in range(2):
        steps = np.cumsum(source.normal((18.0, 0.0), (6.0, 14.0), (90, 2)), axis=0)
        points = np.round(steps + source.uniform(200, 1500, 2)).astype(np.int32)
        points = points[(points > 20).all(axis=1) & (points < TILE_PX - 20).all(axis=1)]
        cv2.polylines(crack, [points], False, 255, 2, cv2.LINE_AA)
    tile *= 1.0 - 0.55 * cv2.GaussianBlur(crack, (0, 0), 1.0).astype(np.float32) / 255.0
    result: Plane = np.clip(tile, 0.15, None).astype(np.float32)
    return result


def _water(source: np.random.Generator) -> Plane:
    """Choppy water from above: wavelets that mirror more or less of the sky, some foam. It stands still."""
    coarse = _clouds(source, 512, (3.0, 8.0), (0.7, 1.0))
    big = cv2.resize(np.pad(coarse, 1, mode="wrap"), None, fx=4, fy=4, interpolation=cv2.INTER_LINEAR)[4:-4, 4:-4]
    small = _grain(source, 3.0)
    tile = 1.0 + 0.35 * np.tanh(big) + 0.15 * small + 2.0 * np.clip(big - 2.2, 0.0, 1.0)
    result: Plane = np.clip(tile, 0.15, None).astype(np.float32)
    return result
