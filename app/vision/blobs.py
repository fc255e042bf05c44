"""Landmarks too small to show their contours: dark quadrangles (the outermost contour) and bright ones (its quiet zone,
or the second contour) of a few pixels, compared with the drawing all at once. Each that resembles it gives hypotheses;
nothing is confirmed here.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.vision.camera_model import tangent_basis
from app.vision.contours import Tree
from app.vision.fit import homography
from app.vision.patch import View
from app.vision.preprocess import Prepared
from app.vision.template import PATCH, PATCH_EXTENT, PSF_SIGMA_PX

SIDES_PX = (7.0, 56.0)
"""Sides of the outermost contour that are looked for this way."""
MIN_COMPACT = 0.04
"""Area over squared number of contour pixels: 1/16 for an upright square, 1/8 for one on its corner."""
MAX_ASPECT = 1.7
MIN_FILLED = 0.68
"""Area over that of the smallest rectangle round it."""
QUAD_TOLERANCE = 0.07
"""Of Douglas and Peucker's, as a part of the contour's pixels."""
MAX_BLOBS = 80
MAX_MAPS = 4
LIKENESS, LIKENESS_SECOND = 0.5, 0.62
"""Correlation with the drawing that is worth a closer look, and of a box made from the second contour: many a bright
spot has something dark round it."""
LIKENESS_SHADED = 0.82
"""The same in two lights, which fit many things."""
MAX_SHADED = 2
DRAWN = 0.5
"""In two lights the drawing must leave less than this part of what the two lights alone leave."""


def _boxes(tree: Tree, prepared: Prepared, view: View) -> tuple[Array, Array]:
    """(n, 4, 2) corners in the frame of what may be the outermost contour, clockwise; (n,) likeness to ask for."""
    reduction = prepared.reduction
    grown = view.geometry.landmark.quiet_zone_m / view.geometry.size_m
    low, high = 2.6 * SIDES_PX[0] / reduction, 4.4 * SIDES_PX[1] * grown / reduction
    smallest = MIN_FILLED * (SIDES_PX[0] / reduction) ** 2
    found = [
        (quad, k)
        for k, area in _compact(tree, np.flatnonzero((tree.length >= low) & (tree.length <= high)), smallest)
        if (quad := _quadrangle(tree.points[k], area)) is not None
    ]
    if not found:
        return np.zeros((0, 4, 2)), np.zeros(0)
    quads, black = np.stack([quad for quad, _ in found]), tree.black_inside[[k for _, k in found]]
    middle = quads.mean(axis=1, keepdims=True)
    arm = quads - middle
    # A contour runs through the middles of black pixels; a bright one is the quiet zone, or the second contour, where
    # a shadow or what lies beside the pad runs into the outermost.
    edge = math.sqrt(0.5) / np.sqrt((arm * arm).sum(axis=2)).mean(axis=1)
    scale = np.where(black, 1.0 + edge, (1.0 - edge) / grown)
    least = np.full(len(scale), LIKENESS)
    if (second := view.geometry.glance.second_part) is not None:
        middle = np.concatenate([middle, middle[~black]])
        # The blur of the dark ring round it makes the second one smaller.
        arm, scale = np.concatenate([arm, arm[~black]]), np.concatenate([scale, (1.0 + 0.5 * edge[~black]) / second])
        least = np.concatenate([least, np.full(int((~black).sum()), LIKENESS_SECOND)])
    arm = arm * scale[:, None, None]
    sides = np.sqrt(((arm - arm[:, [3, 0, 1, 2]]) ** 2).sum(axis=2)) * reduction
    fits = (sides.min(axis=1) >= SIDES_PX[0]) & (sides.max(axis=1) <= SIDES_PX[1])
    return prepared.to_frame((middle + arm)[fits][:MAX_BLOBS]), least[fits][:MAX_BLOBS]


def _compact(tree: Tree, nodes: NDArray[np.intp], least: float) -> list[tuple[int, float]]:
    """Those of the contours that fill their length well enough for a square, with their areas (shoelace formula), at
    least so many squared pixels.
    """
    if not len(nodes):
        return []
    points = np.concatenate([tree.points[k] for k in nodes.tolist()])[:, 0].astype(np.int64)
    ends = np.cumsum(tree.length[nodes])
    starts = np.concatenate([[0], ends[:-1]])
    after = np.arange(1, len(points) + 1)
    after[ends - 1] = starts
    x, y = points.T
    area = 0.5 * np.abs(np.add.reduceat(x * y[after] - x[after] * y, starts))
    good = area >= np.maximum(least, MIN_COMPACT * tree.length[nodes].astype(np.float64) ** 2)
    return list(zip(nodes[good].tolist(), area[good].tolist(), strict=True))


def _quadrangle(points: NDArray[np.int32], area: float) -> Array | None:
    """(4, 2) a contour's corners, clockwise: its own if it has four, else those of the smallest rectangle round it."""
    simple = cv2.approxPolyDP(points, QUAD_TOLERANCE * len(points), True)
    if len(simple) == 4 and cv2.isContourConvex(simple):
        own = simple[:, 0].astype(np.float64)
        covered = cv2.contourArea(simple, oriented=True)
        if abs(covered) > MIN_FILLED * area:
            return own if covered > 0 else own[::-1]
    box = cv2.minAreaRect(points)
    w, h = box[1]
    if max(w, h) > MAX_ASPECT * min(w, h) + 1.0 or area < MIN_FILLED * w * h:
        return None
    corners = cv2.boxPoints(box).astype(np.float64)
    return corners if cv2.contourArea(corners.astype(np.float32), oriented=True) > 0 else corners[::-1]


def _likeness(boxes: Array, view: View) -> tuple[Array, Array]:
    """(n, 4) correlation of each box with the drawing, if its first corner is the drawing's k-th; the same where a
    shadow's edge may lie across it.
    """
    geometry, glance = view.geometry, view.geometry.glance
    at = glance.grid
    middle = boxes.mean(axis=1)
    forward, right = 0.5 * (boxes[:, 0] - boxes[:, 3]), 0.5 * (boxes[:, 1] - boxes[:, 0])
    px = middle[:, None] + at[:, :1] * forward[:, None] + at[:, 1:] * right[:, None] - view.origin
    px32 = px.astype(np.float32)
    grey = cv2.remap(view.image, px32[..., 0], px32[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    values = grey.astype(np.float64)
    values -= values.mean(axis=1, keepdims=True)
    values /= np.sqrt((values * values).sum(axis=1, keepdims=True)) + 1e-9
    side = np.sqrt((forward**2).sum(axis=1)) + np.sqrt((right**2).sum(axis=1))
    found, shaded = np.zeros((len(boxes), 4)), np.zeros((len(boxes), 4))
    classes = np.round(2.0 * np.log2(side)).astype(int)
    for size in np.unique(classes):
        mine = classes == size
        cell_px = 2.0 ** (size / 2.0) * PATCH_EXTENT / PATCH
        templates = glance.templates(geometry.template(PSF_SIGMA_PX / cell_px))
        found[mine] = values[mine] @ templates.T
        shaded[mine] = in_two_lights(values[mine], templates, glance.halves)
    return found, shaded


def in_two_lights(values: Array, templates: Array, halves: Array) -> Array:
    """(n, t) correlation of greys with drawings that have a black and a white of their own on either side of a line,
    the best of several lines; 0 where the drawing explains little that two even greys don't.

    Args:
        values: (n, m) greys, of mean 0 and length 1.
        templates: (t, m) drawings.
        halves: (lines, m) 1 on one side of each line, 0 on the other.
    """
    left, plain = np.zeros((len(values), len(templates), len(halves))), np.zeros((len(values), len(halves)))
    for side in (halves, 1.0 - halves):
        count = side.sum(axis=1)
        drawn, squared = templates @ side.T, (templates * templates) @ side.T
        spread = np.maximum(squared - drawn * drawn / count, 1e-12)
        grey, grey_squared = values @ side.T, (values * values) @ side.T
        both = np.stack([(values * drawing) @ side.T for drawing in templates], axis=1) - grey[:, None] * drawn / count
        flat = grey_squared - grey * grey / count
        plain += flat
        left += flat[:, None] - np.where(both > 0.0, both * both / spread, 0.0)
    left[left > DRAWN * plain[:, None]] = 1.0
    flat_out = (values * values).sum(axis=1) < 0.5
    left[flat_out] = 1.0
    result: Array = np.sqrt(np.clip(1.0 - left.min(axis=2), 0.0, 1.0))
    return result


def blobs(tree: Tree, prepared: Prepared, view: View) -> list[tuple[list[Array], Array]]:
    """Hypotheses, the most alike first: maps rays_from_pad (3, 3) that differ in the heading, and the box (4, 2)."""
    boxes, least = _boxes(tree, prepared, view)
    if not len(boxes):
        return []
    alike, shaded = _likeness(boxes, view)
    best, best_shaded = alike.max(axis=1), shaded.max(axis=1)
    order = np.argsort(-best)
    order = order[best[order] >= least[order]][:MAX_MAPS]
    dim = np.flatnonzero((best < least) & (best_shaded >= LIKENESS_SHADED))
    dim = dim[np.argsort(-best_shaded[dim])][:MAX_SHADED]
    alike[dim] = shaded[dim]
    order = np.concatenate([order, dim])
    found: list[tuple[list[Array], Array]] = []
    for k in order:
        maps = [m for turn in np.argsort(-alike[k])[:2] if (m := _map(boxes[k], int(turn), view)) is not None]
        if maps:
            found.append((maps, boxes[k]))
    return found


def _map(box: Array, turn: int, view: View) -> Array | None:
    """(3, 3) rays_from_pad with the outermost contour's corner `turn` on the first corner of the box."""
    geometry = view.geometry
    rays = view.lens.rays(box)
    if not np.isfinite(rays).all():
        return None
    basis = tangent_basis(rays.sum(axis=0))
    flat = rays @ basis.T
    corners = np.roll(geometry.corners[geometry.slices[0]], -turn, axis=0)
    matrix = homography(corners, flat[:, :2] / flat[:, 2:])
    return None if matrix is None else np.asarray(basis.T @ matrix)
