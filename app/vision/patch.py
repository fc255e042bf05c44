"""The rectified patch: the landmark and its quiet zone sampled through a map of the pad's plane, PATCH x PATCH cells.

It owns the sampling; what the patch says is judged in evidence and used in align.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.messages import Image
from app.vision.camera_model import Lens
from app.vision.fit import project_pad
from app.vision.geometry import NODES, LandmarkGeometry
from app.vision.template import PATCH, PATCH_EXTENT

FAR_OUT_PX = -1e4
SATURATED_DN = 254
"""Grey level from which a pixel may stand for any brightness."""
ROUNDING_DN = 5
CELL_PX = (0.02, 1e4)
"""Smallest and largest cell of a map that is worth a look."""
SAME_PX, SAME_PART = 0.4, 0.005
"""Maps whose corners lie nearer than this, and this part of the side in addition, lead to the same fit."""
_ALL_SEEN: NDArray[np.bool_] = np.ones((PATCH, PATCH), dtype=np.bool_)


class Tried:
    """Maps of one image that were refused: other thresholds lead to the same ones again and again."""

    def __init__(self) -> None:
        self._corners_px: list[Array] = []

    def knows(self, corners_px: Array) -> bool:
        """Whether a map with these corners (n, 2) of the outermost contour was tried, or one next to it; from now on it
        was.
        """
        side_px = float(np.abs(corners_px - np.roll(corners_px, 1, axis=0)).max())
        near = SAME_PX + SAME_PART * side_px
        if any(float(np.abs(before - corners_px).max()) < near for before in self._corners_px):
            return True
        self._corners_px.append(corners_px)
        return False


@dataclass(frozen=True, slots=True)
class View:
    """An image to look at.

    Attributes:
        image: (height, width) grey of the frame, or of a part of it.
        origin: (u, v) of image[0, 0] in the frame.
        geometry: Of the landmark.
        lens: Of the camera.
        tried: What was refused on it.
    """

    image: Image
    origin: tuple[int, int]
    geometry: LandmarkGeometry
    lens: Lens
    tried: Tried = field(default_factory=Tried)


def near_view(view: View, rays_from_pad: Array, first: int) -> tuple[View, Array]:
    """A view of the drawing from a black contour on, and its map (3, 3)."""
    matrix = rays_from_pad.copy()
    matrix[:, 2] += rays_from_pad[:, :2] @ view.geometry.inner_centre_m(first)
    return replace(view, geometry=view.geometry.inner(first)), matrix


@dataclass(frozen=True, slots=True)
class Patch:
    """The rectified landmark.

    Attributes:
        grey: (PATCH, PATCH) sampled through the map, front row first.
        seen: (PATCH, PATCH) whether the cell lies in the image.
        whole: Whether all of it does.
        cell_px: Width of a cell in the image, about.
        clipped: (cells,) whether a saturated pixel has a part in the cell: what is there is at least as bright; None
            where there is none.
    """

    grey: Array
    seen: NDArray[np.bool_]
    whole: bool
    cell_px: float
    clipped: NDArray[np.bool_] | None = None

    @property
    def leads_nowhere(self) -> bool:
        """Whether its cells are so small or so large that the map can't be of a landmark in front of the camera."""
        return not CELL_PX[0] < self.cell_px < CELL_PX[1]


def rectify(view: View, rays_from_pad: Array) -> Patch:
    """Sample the patch of a map."""
    geometry = view.geometry
    nodes, _ = project_pad(rays_from_pad, geometry.patch_nodes, view.lens)
    nodes = nodes - view.origin
    low_u, low_v = nodes.min(axis=0)
    high_u, high_v = nodes.max(axis=0)
    if not math.isfinite(low_u + low_v):
        nodes = np.nan_to_num(nodes, nan=FAR_OUT_PX)
        low_u = FAR_OUT_PX
    spread = geometry.between_nodes
    u = spread @ nodes[:, 0].reshape(NODES, NODES) @ spread.T
    v = spread @ nodes[:, 1].reshape(NODES, NODES) @ spread.T
    height, width = view.image.shape
    whole = bool(low_u >= 0 and low_v >= 0 and high_u <= width - 1 and high_v <= height - 1)
    seen = _ALL_SEEN if whole else (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    u32, v32 = u.astype(np.float32), v.astype(np.float32)
    grey = cv2.remap(view.image, u32, v32, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    clipped = _clipped(view.image, u32, v32) if int(grey.max()) >= SATURATED_DN - ROUNDING_DN else None
    # Length of the middle's two diagonals.
    c = PATCH // 2
    du, dv = u[c, c] - u[c - 1, c - 1], v[c, c] - v[c - 1, c - 1]
    eu, ev = u[c, c - 1] - u[c - 1, c], v[c, c - 1] - v[c - 1, c]
    cell_px = math.sqrt(0.5 * abs(float(du * ev - dv * eu)))
    return Patch(grey.astype(np.float64), seen, whole, cell_px, clipped)


def _clipped(image: Image, u: NDArray[np.float32], v: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """(cells,) whether one of the pixels between which a cell was interpolated is saturated."""
    height, width = image.shape
    u0, v0 = max(0, int(u.min()) - 1), max(0, int(v.min()) - 1)
    u1, v1 = min(width, int(u.max()) + 3), min(height, int(v.max()) + 3)
    if u1 <= u0 or v1 <= v0:
        return None
    _, saturated = cv2.threshold(image[v0:v1, u0:u1], SATURATED_DN - 1, 255, cv2.THRESH_BINARY)
    part = cv2.remap(saturated, u - u0, v - v0, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return (part > ROUNDING_DN).ravel() if part.any() else None


def resemblance(before: Patch, now: Patch) -> float:
    """Correlation of the greys of two patches where both are seen: 1 for the same thing in any even light."""
    a, b = before.grey, now.grey
    if not (before.whole and now.whole):
        both = before.seen & now.seen
        a, b = a[both], b[both]
    if a.size < PATCH:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    length = math.sqrt(float(np.vdot(a, a)) * float(np.vdot(b, b)))
    return float(np.vdot(a, b)) / length if length > 0.0 else 0.0


def side_px(patch: Patch) -> float:
    """Side of the outermost contour in the image, about."""
    return patch.cell_px * PATCH / PATCH_EXTENT
