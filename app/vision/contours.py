"""Contours of a binary image, their hierarchy tree, and the nested polygons (Douglas-Peucker) in it.

Contours are pruned by the hierarchy, their lengths and the landmark's own proportions, with arrays; only the few pairs
that are left are looked at one by one. Polygons are fitted on a plane that is tangent to the view direction, where
straight sides are straight whatever the lens.
Sources: Suzuki and Abe, "Topological structural analysis of digitized binary images by border following", 1985;
Douglas and Peucker, 1973.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.messages import Image
from app.vision.camera_model import Lens, tangent_basis
from app.vision.geometry import LandmarkGeometry
from app.vision.preprocess import Prepared
from app.vision.refusal import Refusal, Rejection

RATIO_SLACK = 1.8
"""A pair's ratio of lengths may differ from the drawing's by this factor: chain codes, blur and perspective."""
MIN_INNER_PX = 9
"""Shortest chain of an inner contour."""
COMPACTNESS_MAX = 48.0
"""Largest perimeter^2 / area: 16 for a square, 20.8 for an equilateral triangle, 30 for one seen at 60 degrees; chain
codes add up to a fifth."""
MAX_NODES = 48
"""Contours looked at one by one, the longest first."""
MAX_POINTS = 100
"""Points of a contour that are used for its polygon."""
TOLERANCES = (0.035, 0.055, 0.08)
"""Douglas-Peucker tolerance over perimeter, tried in this order until three or four corners are left. A square's side
is a quarter of its perimeter; its corners survive up to 0.17."""
MIN_TOLERANCE_PX = 1.2
AREA_AGREEMENT = (0.78, 1.3)
"""A polygon's area over its contour's."""
WIDEST_RAY = 0.17
"""Smallest cosine between a contour's points and its middle: 80 degrees."""


@dataclass(frozen=True, slots=True)
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

    def black(self, index: int) -> bool:
        """Whether the inside of a contour is black: contours with an even number of others round them are."""
        depth = 0
        while (index := int(self.parent[index])) >= 0:
            depth += 1
        return depth % 2 == 0


@dataclass(frozen=True, slots=True)
class Polygon:
    """A contour that Douglas-Peucker made a polygon of.

    Attributes:
        contour: Its index in the tree.
        corners_px: (k, 2) in the frame, clockwise as seen.
        corner_count: k if it is a convex triangle or quadrangle that explains its contour, else 0.
        rejection: Why it is none.
    """

    contour: int
    corners_px: Array
    corner_count: int
    rejection: Rejection | None = None


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
    return Tree(points, np.ascontiguousarray(hierarchy[0, :, 3]), length)  # type: ignore[arg-type]


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


def _outward(corners: Array, by: float) -> Array:
    """A polygon's corners moved so that each side moves outward by about `by` (exactly, if it is regular)."""
    arm = corners - corners.mean(axis=0)
    length = np.sqrt((arm * arm).sum(axis=1)).clip(1e-9)
    result: Array = corners + arm * (by / math.cos(math.pi / len(corners)) / length)[:, None]
    return result


def _polygon(contour: int, px: Array, rays: Array, lens: Lens, basis: Array, outward_px: float) -> Polygon:
    """Douglas-Peucker on the tangent plane of one contour.

    Args:
        contour: Its index.
        px: (m, 2) its points.
        rays: (m, 3) of the same.
        lens: Of the camera.
        basis: (3, 3) tangent_from_cam.
        outward_px: A contour runs through the middles of black pixels; its edge lies this far outside of them.
    """
    flat = rays @ basis.T
    if not flat[:, 2].min() > WIDEST_RAY:
        return Polygon(contour, px[:1], 0, Rejection(Refusal.SHAPE, "a contour spans more than 160 degrees of view"))
    plane = (flat[:, :2] / flat[:, 2:] * lens.focal_px).astype(np.float32)
    area = cv2.contourArea(plane)
    perimeter = cv2.arcLength(plane, True)
    corners: NDArray[np.float32] = plane
    for tolerance in TOLERANCES:
        simple = cv2.approxPolyDP(plane, max(tolerance * perimeter, MIN_TOLERANCE_PX), True)
        corners = np.asarray(simple, dtype=np.float32).reshape(-1, 2)
        if len(corners) <= 4:
            break
    found = _outward(np.array(corners, dtype=np.float64), outward_px)
    if cv2.contourArea(corners, oriented=True) < 0:
        found = found[::-1]
    rays_found = np.column_stack([found / lens.focal_px, np.ones(len(found))]) @ basis
    corners_px, _ = lens.project(rays_found)
    if len(found) not in (3, 4):
        text = f"{len(found)} corners, not 3 or 4"
        return Polygon(contour, corners_px, 0, Rejection(Refusal.CORNERS, text))
    if not cv2.isContourConvex(corners):
        return Polygon(contour, corners_px, 0, Rejection(Refusal.NOT_CONVEX, f"{len(found)} corners, not convex"))
    agreement = cv2.contourArea(corners) / max(area, 1e-9)
    low, high = AREA_AGREEMENT
    if not low <= agreement <= high:
        text = f"polygon covers {agreement:.2f} of its contour's area, outside {low}..{high}"
        return Polygon(contour, corners_px, 0, Rejection(Refusal.CORNERS, text))
    return Polygon(contour, corners_px, len(found))


def polygons(tree: Tree, nodes: NDArray[np.intp], prepared: Prepared, lens: Lens) -> dict[int, Polygon]:
    """The polygon of each contour; those that the border of the region cuts are refused."""
    kept: list[int] = []
    parts: list[Array] = []
    result: dict[int, Polygon] = {}
    height, width = prepared.smooth.shape
    for node in (int(n) for n in nodes):
        points = tree.points[node].reshape(-1, 2)
        low, high = points.min(axis=0), points.max(axis=0)
        part = prepared.to_frame(points[:: len(points) // MAX_POINTS + 1].astype(np.float64))
        if low[0] <= 0 or low[1] <= 0 or high[0] >= width - 1 or high[1] >= height - 1:
            text = f"contour of {len(points)} px is cut by the border of the image"
            result[node] = Polygon(node, part, 0, Rejection(Refusal.CUT_BY_BORDER, text))
            continue
        kept.append(node)
        parts.append(part)
    if not kept:
        return result
    rays = lens.rays(np.concatenate(parts))
    start = 0
    for node, part in zip(kept, parts, strict=True):
        mine = rays[start : start + len(part)]
        start += len(part)
        middle = mine.sum(axis=0)
        if not np.isfinite(middle).all():
            rejection = Rejection(Refusal.SHAPE, "a contour reaches out of the lens's view")
            result[node] = Polygon(node, part, 0, rejection)
            continue
        edge_px = 0.5 * prepared.reduction * (1.0 if tree.black(node) else -1.0)
        result[node] = _polygon(node, part, mine, lens, tangent_basis(middle), edge_px)
    return result


def nests(prepared: Prepared, binary: Image, geometry: LandmarkGeometry, lens: Lens, min_side_px: float) -> list[Nest]:
    """Nested polygons that may be part of the landmark, the largest first.

    Args:
        prepared: The region that was binarised.
        binary: Its binary image, at the resolution of prepared.smooth.
        geometry: Of the landmark.
        lens: Of the camera.
        min_side_px: Shortest side of an outermost contour, in pixels of the frame.
    """
    tree = contour_tree(binary)
    pairs = likely_pairs(tree, geometry, min_side_px / prepared.reduction)
    if not len(pairs):
        return []
    nodes = _compact(tree, np.unique(pairs))
    pairs = pairs[np.isin(pairs, nodes).all(axis=1)]
    if not len(pairs):
        return []
    shapes = polygons(tree, np.unique(pairs), prepared, lens)
    outer_of = {int(child): int(parent) for parent, child in pairs}
    innermost = set(outer_of) - set(outer_of.values())
    found: list[Nest] = []
    for node in innermost:
        chain = [node]
        while chain[-1] in outer_of:
            chain.append(outer_of[chain[-1]])
        chain.reverse()
        found.append(Nest(tuple(shapes[n] for n in chain), tree.black(chain[0])))
    found.sort(key=lambda nest: -int(tree.length[nest.polygons[0].contour]))
    return found
