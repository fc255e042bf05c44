"""Things that lie on the print: leaves, hands, mud, straps, papers. Their part of the marker is exact, by counting."""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np
from grounds import noise
from optics import Array
from prints import SIDE_M
from texture import Texture

SPAN_M = 0.6
SIZE = 1024
KINDS = ("leaf", "hand", "blob", "spatter", "strap", "paper")


def _ring(points: Array) -> Array:
    """Metres to the picture's 1/16 texels."""
    return np.round((points * SIZE / SPAN_M + SIZE / 2) * 16).astype(np.int32)


def _turned(points: Array, turn: float, at: Array) -> Array:
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + at)


def _leaf(rng: np.random.Generator, scale: float, at: Array, turn: float) -> list[Array]:
    t = np.linspace(0, 1, 30)
    half = 0.5 * rng.uniform(0.3, 0.55) * np.sin(math.pi * t) ** rng.uniform(0.8, 1.4) * (1 + 0.08 * np.sin(40 * t))
    x = t - 0.5
    outline = np.concatenate([np.column_stack([x, half]), np.column_stack([x, -half])[::-1]]) * scale
    stem = np.array([[0.48, -0.01], [0.75, 0.03], [0.75, 0.05], [0.48, 0.01]]) * scale
    return [_turned(outline, turn, at), _turned(stem, turn, at)]


def _capsule(a: Array, b: Array, radius: float) -> Array:
    along = math.atan2(b[1] - a[1], b[0] - a[0])
    angles = np.linspace(-math.pi / 2, math.pi / 2, 12)
    cap = np.column_stack([np.cos(angles + along), np.sin(angles + along)]) * radius
    return np.concatenate([b + cap, a - cap])


def _hand(rng: np.random.Generator, scale: float, at: Array, turn: float) -> list[Array]:
    parts = [_capsule(np.array([-0.05, 0.0]), np.array([0.12, 0.0]), 0.2)]
    for k, length in enumerate((0.42, 0.5, 0.47, 0.36)):
        base = np.array([0.15, -0.15 + 0.1 * k])
        spread = (-0.15 + 0.1 * k) * rng.uniform(0.5, 2.0)
        parts.append(_capsule(base, base + length * np.array([math.cos(spread), math.sin(spread)]), 0.048))
    parts.append(_capsule(np.array([-0.1, 0.15]), np.array([0.1, 0.38]), 0.06))
    parts.append(_capsule(np.array([-0.9, 0.0]), np.array([-0.15, 0.0]), 0.14))
    return [_turned(part * scale, turn, at) for part in parts]


def _blob(rng: np.random.Generator, scale: float, at: Array) -> Array:
    angles = np.linspace(0, 2 * math.pi, 48, endpoint=False)
    radius = 0.5 + sum(rng.normal(0, 0.13 / k) * np.cos(k * angles + rng.uniform(0, 2 * math.pi)) for k in range(1, 7))
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) * np.maximum(radius, 0.1)[:, None] * scale
    return np.asarray(ring + at)


def _shapes(rng: np.random.Generator, kind: str, part: float) -> list[Array]:
    """Outlines, roughly of this part of the marker's area."""
    scale = SIDE_M * math.sqrt(part)
    at = rng.uniform(-0.5, 0.5, 2) * SIDE_M
    turn = rng.uniform(0, 2 * math.pi)
    if kind == "leaf":
        count = int(rng.integers(1, 5))
        shapes = []
        for _ in range(count):
            place = rng.uniform(-0.5, 0.5, 2) * SIDE_M
            shapes += _leaf(rng, scale * 2.0 / math.sqrt(count), place, rng.uniform(0, 2 * math.pi))
        return shapes
    if kind == "hand":
        return _hand(rng, scale * 1.3, at, turn)
    if kind == "blob":
        return [_blob(rng, scale * 1.3, at)]
    if kind == "spatter":
        count = int(rng.integers(3, 12))
        places = rng.uniform(-0.52, 0.52, (count, 2)) * SIDE_M
        sizes = rng.uniform(0.4, 1.3, count)
        return [_blob(rng, scale * 1.3 * s / math.sqrt(count), p) for s, p in zip(sizes, places, strict=True)]
    if kind == "strap":
        width = part * SIDE_M * 0.9
        box = np.array([[-0.4, -width / 2], [0.4, -width / 2], [0.4, width / 2], [-0.4, width / 2]])
        return [_turned(box, turn, at * 0.8)]
    box = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * scale * 1.15
    return [_turned(box * np.array([1.0, rng.uniform(0.6, 1.4)]), turn, at)]


def _covered(alpha: Array) -> float:
    """Part of the marker's square under it."""
    half = round(SIDE_M / 2 / SPAN_M * SIZE)
    middle = slice(SIZE // 2 - half, SIZE // 2 + half)
    return float(alpha[middle, middle].mean())


@lru_cache(maxsize=16)
def cover(seed: int, low: float, high: float) -> tuple[Texture, float, str]:
    """Something on the print that covers between low and high of the marker's square.

    Returns:
        Texture of alpha and alpha times albedo; the part covered; what it is.
    """
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(KINDS))
    aim = rng.uniform(low, high)
    for _ in range(200):
        shapes = _shapes(rng, kind, aim)
        alpha: Array = np.zeros((SIZE, SIZE), np.float32)
        for shape in shapes:
            cv2.fillPoly(alpha, [_ring(shape)], 1.0, cv2.LINE_AA, 4)
        part = _covered(alpha)
        if low <= part <= high and abs(part - aim) < 0.03:
            break
    else:
        raise RuntimeError(f"no {kind} covers {aim:.2f}")
    base = float(rng.choice([rng.uniform(0.02, 0.08), rng.uniform(0.1, 0.4), rng.uniform(0.5, 0.85)]))
    grain = noise(rng, SIZE, rng.uniform(0.4, 1.6))
    albedo = np.clip(base * (1 + rng.uniform(0.03, 0.45) * grain), 0.01, 0.95)
    return Texture(np.stack([alpha, alpha * albedo], axis=-1).astype(np.float32), SPAN_M, wraps=False), part, kind
