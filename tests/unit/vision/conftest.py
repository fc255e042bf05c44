"""Maps of the pad's plane for the tests of vision: the true one from the drawn view, others off by known amounts, and
how far apart two lie in the image, by the tests' own lens formulas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from app.vision.camera_model import Lens, lens_from_config
from app.vision.geometry import LandmarkGeometry
from app.vision.patch import View

F64 = NDArray[np.float64]
SIDE_M = 0.38
UNIT_M = SIDE_M / 2


@dataclass(frozen=True)
class Maps:
    """Sums with maps rays_from_pad (3, 3) of the paper's landmark."""

    geometry: LandmarkGeometry

    def true(self, view) -> F64:
        """[r1 r2 t] of the drawn view."""
        return np.column_stack([view.rotation[:, :2], view.t])

    def off_by(self, view, size_px: float, side_px: float, seed: int = 0) -> F64:
        """A map that is wrong in all eight ways: the corners of the outermost contour are size_px off, root mean
        square (to first order), where a side has side_px.
        """
        d = np.random.default_rng(seed).normal(size=8) * [1, 1, 1, 1, 1, 1, 0.3, 0.3]
        square = np.array([[1.0, -1, 1], [1, 1, 1], [-1, 1, 1], [-1, -1, 1]])
        warp = np.append(d, 0.0).reshape(3, 3)
        moved = square @ warp.T
        flat = moved[:, :2] - square[:, :2] * moved[:, 2:]
        d *= size_px / (0.5 * side_px) / np.sqrt((flat**2).sum(axis=1).mean())
        scale = np.diag([UNIT_M, UNIT_M, 1.0])
        return self.true(view) @ scale @ (np.eye(3) + np.append(d, 0.0).reshape(3, 3)) @ np.linalg.inv(scale)

    def warp_to_truth(self, rays_from_pad: F64, view) -> F64:
        """(8,) the d of PlaneFit that takes a map to the true one."""
        scale = np.diag([UNIT_M, UNIT_M, 1.0])
        warp = np.linalg.inv(rays_from_pad @ scale) @ self.true(view) @ scale
        return (warp / warp[2, 2] - np.eye(3)).reshape(-1)[:8]

    def square_per_dof(self, fit, view) -> float:
        """d' Lambda d / 8: 1 on average where the information is that of the errors."""
        d = self.warp_to_truth(fit.rays_from_pad, view)
        return float(d @ fit.information @ d) / 8

    def distances_px(self, rays_from_pad: F64, view, lens, contours=range(5), *, in_image: bool = True) -> F64:
        """How far the corners that lie in the image (or all) are from where they truly are."""
        corners = np.concatenate([self.geometry.landmark.contours[k].corners_m for k in contours])
        flat = np.column_stack([corners, np.ones(len(corners))])
        truth, found = lens.project(flat @ self.true(view).T), lens.project(flat @ rays_from_pad.T)
        inside = ((truth >= 0) & (truth <= (lens.width - 1, lens.height - 1))).all(axis=1) | (not in_image)
        return np.linalg.norm(found - truth, axis=1)[inside]

    def rms_px(self, rays_from_pad: F64, view, lens, contours=range(5), *, in_image: bool = True) -> float:
        """Root mean square of these distances."""
        return float(np.sqrt(np.mean(self.distances_px(rays_from_pad, view, lens, contours, in_image=in_image) ** 2)))

    def lens(self, lens) -> Lens:
        """The application's lens of the same formula."""
        return lens_from_config(lens.config)

    def look_at(self, image, lens) -> View:
        """A whole frame to look at."""
        return View(image, (0, 0), self.geometry, self.lens(lens))


@pytest.fixture(scope="session")
def maps(scene) -> Maps:
    """Of the paper's landmark."""
    return Maps(LandmarkGeometry(scene.landmark))


@pytest.fixture(scope="session")
def changed(scene):
    """Polygons of the landmark with a contour left out, or turned about its own centroid, with all that is drawn in it
    as it was.
    """

    def change(*, without=(), upside_down=()):
        zone, *contours = scene.polygons()
        result = [zone]
        for k, (corners, grey) in enumerate(contours):
            turned = 2.0 * corners.mean(axis=0) - corners
            result += [] if k in without else [(turned if k in upside_down else corners, grey)]
        return result

    return change
