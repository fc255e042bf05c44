"""Contours of a binary image, their hierarchy tree, and the nested polygons in it.

Contours are pruned by the hierarchy, their lengths and the landmark's own proportions, with arrays; only the few pairs
that are left are looked at one by one.
Source: Suzuki and Abe, "Topological structural analysis of digitized binary images by border following", 1985.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from app.messages import Image
from app.vision.camera_model import Lens
from app.vision.geometry import LandmarkGeometry
from app.vision.polygons import Polygon, polygons
from app.vision.preprocess import Prepared

RATIO_SLACK = 1.8
"""A pair's ratio of lengths may differ from the drawing's by this factor: chain codes, blur and perspective."""
MIN_INNER_PX = 9
"""Shortest chain of an inner contour."""
COMPACTNESS_MAX = 48.0
"""Largest perimeter^2 / area: 16 for a square, 20.8 for an equilateral triangle, 30 for one seen at 60 degrees; chain
codes add up to a fifth."""
MAX_NODES = 48
"""Contours looked at one by one, the longest first."""


@dataclass(frozen=True)
class Tree:
    """All contours of a binary image.

    Attributes:
        points: For each (m, 1, 2) pixels.
        parent: (n,) index of the contour round each, -1 for none.
        length: (n,) number of pixels.
    """

    points: Sequence[NDArray[np.int32]]
    parent: NDArray[np.int32]
    length: NDArray[np.int32]

    @cached_property
    def black_inside(self) -> NDArray[np.bool_]:
        """(n,) whether the inside of each is black: contours with an even number of others round them are."""
        black = np.ones(len(self.parent), dtype=bool)
        above = self.parent
        while (inner := above >= 0).any():
            black ^= inner
            above = np.where(inner, self.parent[above], -1)
        return black


@dataclass(frozen=True, slots=True)
class Nest:
    """Polygons one inside the other, outermost first, as far as the pairs reach.

    Attributes:
        polygons: Of them all.
        outermost_black: Colour inside the outermost.
    """

    polygons: tuple[Polygon, ...]
    outermost_black: bool


def contour_tree(binary: Image) -> Tree:
    """Every contour of a binary image with its place in the hierarchy."""
    points, hierarchy = cv2.findContours(binary, cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE)
    if hierarchy is None:
        none = np.zeros(0, dtype=np.int32)
        return Tree((), none, none)
    length = np.fromiter(map(len, points), dtype=np.int32, count=len(points))
    return Tree(points, np.ascontiguousarray(hierarchy[0, :, 3]), length)  # type: ignore[arg-type]  # OpenCV returns int32 arrays


def likely_pairs(tree: Tree, geometry: LandmarkGeometry, min_side_px: float) -> NDArray[np.intp]:
    """(k, 2) indices of an outer contour and one in it whose lengths suit some neighbours of the landmark."""
    child = np.flatnonzero((tree.parent >= 0) & (tree.length >= MIN_INNER_PX))
    parent = tree.parent[child].astype(np.intp)
    outer, inner = tree.length[parent], tree.length[child]
    ratios = geometry.perimeter_ratios
    fits = (outer >= 2.6 * min_side_px) & (outer <= RATIO_SLACK * max(ratios) * inner)
    fits &= outer * RATIO_SLACK >= min(ratios) * inner
    return np.column_stack([parent, child])[fits]


def _compact(tree: Tree, nodes: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of the contours that aren't ragged, the longest MAX_NODES of them."""
    nodes = nodes[np.argsort(-tree.length[nodes], kind="stable")]
    kept: list[int] = []
    for node in nodes:
        points = tree.points[node]
        area = cv2.contourArea(points)
        # The chain's length in pixels is at most the perimeter and at least 1/sqrt(2) of it.
        if area > 3.0 and len(points) ** 2 <= COMPACTNESS_MAX * area:
            kept.append(int(node))
            if len(kept) == MAX_NODES:
                break
    return np.array(kept, dtype=np.intp)


def nests(prepared: Prepared, tree: Tree, geometry: LandmarkGeometry, lens: Lens, min_side_px: float) -> list[Nest]:
    """Nested polygons that may be part of the landmark, the largest first.

    Args:
        prepared: The region that was binarised.
        tree: Contours of its binary image, at the resolution of prepared.smooth.
        geometry: Of the landmark.
        lens: Of the camera.
        min_side_px: Shortest side of an outermost contour, in pixels of the frame.
    """
    pairs = likely_pairs(tree, geometry, min_side_px / prepared.reduction)
    if not len(pairs):
        return []
    nodes = _compact(tree, np.unique(pairs))
    pairs = pairs[np.isin(pairs, nodes).all(axis=1)]
    if not len(pairs):
        return []
    kept = [int(n) for n in np.unique(pairs)]
    outlines = [tree.points[n] for n in kept]
    shapes = dict(
        zip(kept, polygons(outlines, [bool(tree.black_inside[n]) for n in kept], prepared, lens), strict=True)
    )
    outer_of = {int(child): int(parent) for parent, child in pairs}
    innermost = set(outer_of) - set(outer_of.values())
    found: list[Nest] = []
    for node in innermost:
        chain = [node]
        while chain[-1] in outer_of:
            chain.append(outer_of[chain[-1]])
        chain.reverse()
        found.append(Nest(tuple(shapes[n] for n in chain), bool(tree.black_inside[chain[0]])))
    found.sort(key=lambda nest: -nest.polygons[0].length_px)
    return found
