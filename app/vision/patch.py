"""The rectified patch: the landmark and its quiet zone sampled through a map of the pad's plane, PATCH x PATCH cells.

It owns the sampling; what the patch says is judged in evidence and used in align.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from app.frames import Array
from app.messages import Image
from app.vision.camera_model import Lens
from app.vision.fit import project_pad
from app.vision.geometry import NODES, PATCH, PATCH_EXTENT, LandmarkGeometry

FAR_OUT_PX = -1e4
_ALL_SEEN: NDArray[np.bool_] = np.ones((PATCH, PATCH), dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class View:
    """An image to look at.

    Attributes:
        image: (height, width) grey of the frame, or of a part of it.
        origin: (u, v) of image[0, 0] in the frame.
        geometry: Of the landmark.
        lens: Of the camera.
    """

    image: Image
    origin: tuple[int, int]
    geometry: LandmarkGeometry
    lens: Lens


@dataclass(frozen=True, slots=True)
class Patch:
    """The rectified landmark.

    Attributes:
        grey: (PATCH, PATCH) sampled through the map, front row first.
        seen: (PATCH, PATCH) whether the cell lies in the image.
        whole: Whether all of it does.
        cell_px: Width of a cell in the image, about.
    """

    grey: Array
    seen: NDArray[np.bool_]
    whole: bool
    cell_px: float

    def turned(self, quarters: int) -> Patch:
        """The patch as a map sees it that is turned by so many quarter turns clockwise."""
        seen = self.seen if self.whole else np.rot90(self.seen, quarters)
        return Patch(np.rot90(self.grey, quarters), seen, self.whole, self.cell_px)


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
    grey = cv2.remap(
        view.image, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    # Length of the middle's two diagonals.
    c = PATCH // 2
    du, dv = u[c, c] - u[c - 1, c - 1], v[c, c] - v[c - 1, c - 1]
    eu, ev = u[c, c - 1] - u[c - 1, c], v[c, c - 1] - v[c - 1, c]
    cell_px = math.sqrt(0.5 * abs(float(du * ev - dv * eu)))
    return Patch(grey.astype(np.float64), seen, whole, cell_px)


def side_px(patch: Patch) -> float:
    """Side of the outermost contour in the image, about."""
    return patch.cell_px * PATCH / PATCH_EXTENT
