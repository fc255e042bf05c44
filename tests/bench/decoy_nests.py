"""Decoys that are nests of squares and triangles: the landmark with something wrong in it, and simpler nests.

It owns their shapes; what a decoy is and how it is drawn is in decoys.py.
"""

from __future__ import annotations

import math

import numpy as np
from decoys import (
    BLACK,
    Drawing,
    Family,
    Poly,
    disc,
    kind,
    landmark_polygons,
    nest,
    regular,
    scaled,
    square,
    triangle,
    turned,
)


def _middle(poly: Poly) -> Poly:
    """(2,) of its bounding box."""
    result: Poly = (poly.min(axis=0) + poly.max(axis=0)) / 2
    return result


# ------------------------------------------------------------------------------- the landmark, with something wrong
@kind("t3-upside-down", Family.NEAR)
def _t3_upside_down(source: np.random.Generator) -> Drawing:
    s1, s2, t3, t4, s5 = landmark_polygons()
    flipped = turned(t3, 180, _middle(t3))
    if source.random() < 0.5:  # what lies in it shrinks until it fits
        to = flipped.mean(axis=0) - t4.mean(axis=0)
        t4, s5 = (scaled(p, 0.42, t4.mean(axis=0)) + to for p in (t4, s5))
    return Drawing(nest([s1, s2, flipped, t4, s5]))


@kind("t4-upside-down", Family.NEAR)
def _t4_upside_down(source: np.random.Generator) -> Drawing:
    s1, s2, t3, t4, s5 = landmark_polygons()
    centre = t3.mean(axis=0)
    flipped = turned(t4, 180, centre)
    if source.random() < 0.5:
        flipped, s5 = scaled(flipped, 0.62, centre), scaled(s5, 0.62, centre)
    return Drawing(nest([s1, s2, t3, flipped, s5]))


@kind("t3-t4-upside-down", Family.NEAR)
def _both_upside_down(source: np.random.Generator) -> Drawing:
    s1, s2, t3, t4, s5 = landmark_polygons()
    middle = _middle(t3)
    t4 = turned(t4, 180, middle)
    if source.random() < 0.5:  # the innermost square in the corner where it was
        s5 = scaled(s5, float(source.uniform(1.0, 1.5)))
        return Drawing(nest([s1, s2, turned(t3, 180, middle), t4, s5 + np.array([0.0, 0.06])]))
    return Drawing(nest([s1, s2, turned(t3, 180, middle), t4, s5]))


@kind("s5-missing", Family.ARGUABLE)
def _s5_missing(source: np.random.Generator) -> Drawing:
    return Drawing(nest(landmark_polygons()[:4]))


@kind("s5-moved", Family.INNERMOST)
def _s5_moved(source: np.random.Generator) -> Drawing:
    *outer, s5 = landmark_polygons()
    a = source.uniform(0, math.tau)
    return Drawing(nest([*outer, s5 + np.array([math.cos(a), math.sin(a)]) * source.uniform(0.14, 0.35)]))


@kind("s5-triangle", Family.INNERMOST)
def _s5_triangle(source: np.random.Generator) -> Drawing:
    *outer, _ = landmark_polygons()
    inner = triangle(float(source.uniform(0.17, 0.25)), tuple(outer[3].mean(axis=0)))
    return Drawing(nest([*outer, turned(inner, float(source.choice([0.0, 180.0])), outer[3].mean(axis=0))]))


@kind("s5-disc", Family.INNERMOST)
def _s5_disc(source: np.random.Generator) -> Drawing:
    *outer, _ = landmark_polygons()
    return Drawing(nest([*outer, disc(float(source.uniform(0.075, 0.105)), tuple(outer[3].mean(axis=0)))]))


@kind("s5-diamond", Family.INNERMOST)
def _s5_diamond(source: np.random.Generator) -> Drawing:
    *outer, s5 = landmark_polygons()
    return Drawing(nest([*outer, scaled(turned(s5, 45, s5.mean(axis=0)), float(source.uniform(0.9, 1.25)))]))


@kind("triangles-turned", Family.NEAR)
def _triangles_turned(source: np.random.Generator) -> Drawing:
    s1, s2, *inner = landmark_polygons()
    about = _middle(inner[0])
    deg = float(source.choice([30, 45, 60, 45, -45, 120, 15, 20])) + float(source.uniform(-3, 3))
    return Drawing(nest([s1, s2, *(turned(p, deg, about) for p in inner)]))


@kind("t3-turned", Family.NEAR)
def _t3_turned(source: np.random.Generator) -> Drawing:
    s1, s2, t3, t4, s5 = landmark_polygons()
    return Drawing(nest([s1, s2, turned(t3, float(source.choice([90, -90, 60])), _middle(t3)), t4, s5]))


@kind("t4-turned", Family.NEAR)
def _t4_turned(source: np.random.Generator) -> Drawing:
    s1, s2, t3, t4, s5 = landmark_polygons()
    centre = t3.mean(axis=0)
    factor = float(source.choice([0.62, 1.0]))
    t4, s5 = scaled(turned(t4, float(source.choice([90, -90, 60, 30])), centre), factor), scaled(s5, factor, centre)
    return Drawing(nest([s1, s2, t3, t4, s5]))


@kind("triangles-shifted", Family.NEAR)
def _triangles_shifted(source: np.random.Generator) -> Drawing:
    s1, s2, *inner = landmark_polygons()
    a = source.uniform(0, math.tau)
    by = np.array([math.cos(a), math.sin(a)]) * source.uniform(0.10, 0.16)
    return Drawing(nest([s1, s2, *(p + by for p in inner)]))


@kind("squares-turned", Family.NEAR)
def _squares_turned(source: np.random.Generator) -> Drawing:
    s1, s2, *inner = landmark_polygons()
    return Drawing(nest([s1, turned(scaled(s2, 0.97), float(source.choice([45, 30, 20]))), *inner]))


@kind("s2-ratio", Family.NEAR)
def _s2_ratio(source: np.random.Generator) -> Drawing:
    s1, s2, *inner = landmark_polygons()
    factor = float(source.choice([math.sqrt(2 / 3), math.sqrt(0.52), 1.22, 1.3]))
    inner = [scaled(p, min(1.0, factor * 1.05), (0.0, 0.0)) for p in inner]
    return Drawing(nest([s1, scaled(s2, factor), *inner]))


@kind("t3-ratio", Family.NEAR)
def _t3_ratio(source: np.random.Generator) -> Drawing:
    s1, s2, *inner = landmark_polygons()
    factor = float(source.choice([0.6, 0.7, 1.25, 1.3]))
    return Drawing(nest([s1, s2, *(scaled(p, factor, _middle(inner[0])) for p in inner)]))


@kind("t4-ratio", Family.NEAR)
def _t4_ratio(source: np.random.Generator) -> Drawing:
    s1, s2, t3, t4, s5 = landmark_polygons()
    factor = float(source.choice([0.6, 0.65, 1.25, 1.3]))
    return Drawing(nest([s1, s2, t3, scaled(t4, factor), scaled(s5, min(factor, 1.0), t4.mean(axis=0))]))


@kind("s5-ratio", Family.INNERMOST)
def _s5_ratio(source: np.random.Generator) -> Drawing:
    *outer, s5 = landmark_polygons()
    return Drawing(nest([*outer, scaled(s5, float(source.choice([0.4, 1.55, 1.7])))]))


@kind("circle-in-place", Family.NEAR)
def _circle_in_place(source: np.random.Generator) -> Drawing:
    polygons = landmark_polygons()
    which: list[int] = [[0], [1], [2], [3], [0, 1], [2, 3], [2, 3, 4], [0, 1, 4], [0, 1, 2, 3, 4]][source.integers(9)]
    for k in which:
        x, y = polygons[k].T
        area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
        centre = polygons[k].mean(axis=0)
        inside = 0.5 * math.sqrt(0.5) * 0.98 if k == 0 and 1 not in which else 0.0
        polygons[k] = disc(max(math.sqrt(area / math.pi), inside), (float(centre[0]), float(centre[1])))
    return Drawing(nest(polygons))


@kind("squares-for-triangles", Family.NEAR)
def _squares_for_triangles(source: np.random.Generator) -> Drawing:
    s1, s2, *_ = landmark_polygons()
    sides = [math.sqrt(r) for r in (1 / 8, 1 / 16, 1 / 64)]
    deg = float(source.choice([0.0, 45.0]))
    return Drawing(nest([s1, s2, *(turned(square(s), deg) for s in sides)]))


@kind("triangles-for-squares", Family.NEAR)
def _triangles_for_squares(source: np.random.Generator) -> Drawing:
    sides = [1.1, 0.82, 0.5, 0.34, 0.16][: int(source.integers(3, 6))]
    return Drawing(nest([triangle(s, (0.0, 0.12)) for s in sides]), board=1.5)


@kind("inverted", Family.NEAR)
def _inverted(source: np.random.Generator) -> Drawing:
    return Drawing(nest(landmark_polygons(), inverted=True), board_grey=float(source.choice([BLACK, BLACK, 0.35])))


@kind("inner-inverted", Family.NEAR)
def _inner_inverted(source: np.random.Generator) -> Drawing:
    s1, s2, *inner = landmark_polygons()
    if source.random() < 0.5:
        return Drawing((*nest([s1]), *nest(inner, inverted=True)))
    return Drawing((*nest([s1, s2, s2 * 0.9]), *nest(inner, inverted=True)))


@kind("faded", Family.ARGUABLE)
def _faded(source: np.random.Generator) -> Drawing:
    """The landmark printed in two greys that no camera here sees 8 levels apart."""
    low = float(source.uniform(0.25, 0.6))
    greys = (low, low + 0.02)
    shapes = tuple((poly, greys[k % 2]) for k, poly in enumerate(landmark_polygons()))
    return Drawing(shapes, board_grey=greys[1])


@kind("inner-run-alone", Family.ARGUABLE)
def _inner_run_alone(source: np.random.Generator) -> Drawing:
    """The landmark's own inner contours with none of the squares round them."""
    polygons = landmark_polygons()
    if source.random() < 0.5:
        return Drawing(tuple(nest(polygons)[2:]), board=float(source.uniform(0.75, 1.1)))
    return Drawing(tuple(nest(polygons)[3:]), board=0.6, board_grey=BLACK)


# --------------------------------------------------------------------------------------------------- simple nests
@kind("square-in-square", Family.NEAR)
def _square_in_square(source: np.random.Generator) -> Drawing:
    ratio = float(source.choice([1 / 2, 1 / 2, 1 / 4, 0.7, source.uniform(0.1, 0.9)]))
    return Drawing(nest([square(1.0), square(math.sqrt(ratio))], inverted=bool(source.random() < 0.2)))


@kind("nested-squares", Family.NEAR)
def _nested_squares(source: np.random.Generator) -> Drawing:
    count = int(source.integers(3, 6))
    if source.random() < 0.3:
        sides = [math.sqrt(r) for r in (1, 1 / 2, 1 / 8, 1 / 16, 1 / 64)][:count]
    elif source.random() < 0.5:
        sides = [math.sqrt(0.5) ** k for k in range(count)]
    else:
        sides = [1.0 - k / count for k in range(count)]
    return Drawing(nest([square(s) for s in sides]))


@kind("triangle-in-square", Family.NEAR)
def _triangle_in_square(source: np.random.Generator) -> Drawing:
    s1, s2, t3, *_ = landmark_polygons()
    which = int(source.integers(4))
    if which == 0:  # the landmark's first three contours and nothing in them
        return Drawing(nest([s1, s2, t3]))
    if which == 1:
        return Drawing(nest([s1, scaled(t3, 1.5, _middle(t3))]))
    inner = turned(triangle(float(source.uniform(0.3, 0.55)), (0.0, 0.05)), float(source.uniform(0, 120)))
    return Drawing(nest([s1, s2, inner] if which == 2 else [s1, inner]))


@kind("square-in-triangle", Family.NEAR)
def _square_in_triangle(source: np.random.Generator) -> Drawing:
    outer = triangle(1.1, (0.0, 0.1))
    inner = square(float(source.uniform(0.15, 0.44)), (0.0, 0.1))
    if source.random() < 0.5:
        inner = turned(inner, float(source.uniform(20, 70)), (0.0, 0.1))
    return Drawing(nest([outer, inner], inverted=bool(source.random() < 0.3)), board=1.4)


@kind("two-triangles", Family.NEAR)
def _two_triangles(source: np.random.Generator) -> Drawing:
    inner = triangle(1.1 * math.sqrt(float(source.choice([0.5, 0.25, 0.7]))), (0.0, 0.1))
    if source.random() < 0.3:
        inner = turned(scaled(inner, 0.55), 180, (0.0, 0.1))
    return Drawing(nest([triangle(1.1, (0.0, 0.1)), inner]), board=1.4)


@kind("two-triangles-in-square", Family.NEAR)
def _two_triangles_in_square(source: np.random.Generator) -> Drawing:
    s1, s2, t3, t4, _ = landmark_polygons()
    about = _middle(t3)
    outer, inner = scaled(t3, float(source.uniform(1.2, 1.5)), about), scaled(t4, float(source.uniform(0.5, 0.9)))
    if source.random() < 0.5:
        return Drawing(nest([s1, s2, turned(outer, 180, about), turned(scaled(inner, 0.6), 180, about)]))
    return Drawing(nest([s1, outer, inner]))


@kind("square-in-triangle-in-square", Family.NEAR)
def _square_in_triangle_in_square(source: np.random.Generator) -> Drawing:
    s1, s2, t3, _, s5 = landmark_polygons()
    t3 = scaled(t3, float(source.uniform(1.0, 1.25)), _middle(t3))
    return Drawing(nest([s1, s2, t3, scaled(s5, float(source.uniform(1.0, 1.6)), t3.mean(axis=0))]))


@kind("plain-shape", Family.NEAR)
def _plain_shape(source: np.random.Generator) -> Drawing:
    shape = [square(1.0), triangle(1.1), disc(0.5), regular(5, 0.55), regular(6, 0.55)][source.integers(5)]
    frame = bool(source.random() < 0.5)
    return Drawing(nest([shape, scaled(shape, 0.8), scaled(shape, 0.72)] if frame else [shape]))


@kind("polygon-nest", Family.NEAR)
def _polygon_nest(source: np.random.Generator) -> Drawing:
    """Nests of other polygons, at the landmark's own ratios."""
    corners = source.choice([3, 4, 5, 6, 8, 96], 5)
    corners[source.integers(2)] = int(source.choice([5, 6, 8]))
    radius = [0.62, 0.43, 0.25, 0.17, 0.075]
    return Drawing(nest([regular(int(n), r, turn_deg=-90) for n, r in zip(corners, radius, strict=True)]), board=1.5)
