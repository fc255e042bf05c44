"""The four printed markers on their boards, at equal size: 38 cm from outer black edge to outer black edge.

Each is a picture of two coverages, paper and ink, true to area. Alight's landmark is drawn from its polygons; the tags
are grids of modules with a white margin of one module (Alight's own margin is 4 cm).
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from optics import Array
from texture import Texture

from app.landmark import Shape, paper_landmark

SIDE_M = 0.38
MARKERS = ("alight", "aruco4", "aruco6", "apriltag")
TEXELS = 4096
SPAN_M = 0.56
TAG_ID = 7
CORNERS_M = np.array([[0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]]) * SIDE_M
"""(4, 2) forward, right of the outer black corners: front-left, front-right, back-right, back-left."""


def _edges() -> Array:
    """(TEXELS + 1,) metres of the texels' edges from the middle."""
    return np.linspace(-SPAN_M / 2, SPAN_M / 2, TEXELS + 1)


def _band(low: float, high: float) -> Array:
    """(TEXELS,) part of each texel that lies between two places, exact."""
    edges = np.clip(_edges(), low, high)
    return (np.diff(edges) * TEXELS / SPAN_M).astype(np.float32)


def _rectangle(corners: Array) -> Array:
    """(TEXELS, TEXELS) coverage of an axis-aligned rectangle, corners (4, 2) forward, right."""
    rows = _band(-float(corners[:, 0].max()), -float(corners[:, 0].min()))
    columns = _band(float(corners[:, 1].min()), float(corners[:, 1].max()))
    return np.outer(rows, columns)


def _polygon(corners: Array) -> Array:
    """(TEXELS, TEXELS) coverage of a convex polygon (n, 2) forward, right, clockwise seen from above.

    A straight edge at signed distance d (in texels) from a texel's middle covers 1/2 + d of it, to second order.
    """
    middles = (_edges()[:-1] + _edges()[1:]) / 2
    x, y = corners[:, 1], -corners[:, 0]
    coverage: Array = np.ones((TEXELS, TEXELS), np.float32)
    for k in range(len(corners)):
        dx, dy = np.roll(x, -1)[k] - x[k], np.roll(y, -1)[k] - y[k]
        length = float(np.hypot(dx, dy))
        across = (-dy * (middles - x[k]))[None, :] + (dx * (middles - y[k]))[:, None]
        coverage = np.minimum(coverage, np.clip(0.5 + across / length * TEXELS / SPAN_M, 0.0, 1.0))
    return coverage


def _alight() -> tuple[Array, float]:
    """Ink coverage and side of the board."""
    landmark = paper_landmark(SIDE_M)
    ink: Array = np.zeros((TEXELS, TEXELS), np.float32)
    for contour in landmark.contours:
        draw = _rectangle if contour.shape is Shape.SQUARE else _polygon
        coverage = draw(contour.corners_m)
        ink = ink * (1 - coverage) + coverage * contour.black
    return ink, landmark.quiet_zone_m


def _tag(dictionary: int, modules: int) -> tuple[Array, float]:
    """Ink coverage and side of the board of a tag, `modules` across with its black border."""
    cells = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(dictionary), TAG_ID, modules) < 128
    places = np.linspace(-SIDE_M / 2, SIDE_M / 2, modules + 1)
    bands = np.stack([_band(places[k], places[k + 1]) for k in range(modules)], axis=1)
    ink = bands @ cells.astype(np.float32) @ bands.T
    return ink, SIDE_M * (modules + 2) / modules


@lru_cache
def marker_texture(name: str) -> Texture:
    """A marker's board: channels paper and ink, uint8 parts of 255. Columns run right, rows backward."""
    if name == "alight":
        ink, board = _alight()
    else:
        dictionary, modules = {
            "aruco4": (cv2.aruco.DICT_4X4_50, 6),
            "aruco6": (cv2.aruco.DICT_6X6_50, 8),
            "apriltag": (cv2.aruco.DICT_APRILTAG_36h11, 8),
        }[name]
        ink, board = _tag(dictionary, modules)
    half = board / 2
    all_of_it = _rectangle(np.array([[half, -half], [half, half], [-half, half], [-half, -half]]))
    picture = np.stack([all_of_it * (1 - ink), all_of_it * ink], axis=-1)
    return Texture((picture * 255 + 0.5).astype(np.uint8), SPAN_M, wraps=False)
