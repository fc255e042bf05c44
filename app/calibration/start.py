"""Where the fit begins: a focal length, and the pose of the board in every view.

Focal lengths are tried from the shortest to the longest that lenses have. For each, the corners' rays give each view's
pose by the direct linear transform of a plane (Hartley and Zisserman, "Multiple view geometry", 2004, section 4.1), on
rays instead of pixels: it holds beyond 90 degrees from the axis too, where OpenCV's fisheye calibration gives up.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.calibration.board import View
from app.calibration.bundle import Bundle, Fitted, Poses, fit
from app.calibration.parameters import Model, ModelName
from app.errors import CalibrationError
from app.frames import Array

FOCAL_PARTS: dict[ModelName, Array] = {
    "pinhole": np.geomspace(0.25, 8.0, 16),
    "equidistant": np.geomspace(0.2, 3.0, 12),
}
"""Focal lengths to try, in image widths: 127 to 7 degrees across; 286 to 19 degrees."""
TRIED_VIEWS = 12
"""More don't make the focal length clearer."""
BEST = 3
"""So many of the focal lengths are fitted, to TRIED_VIEWS; the best of them then to all."""


def pose_from_rays(corners_m: Array, rays: Array) -> tuple[Array, Array]:
    """Pose of a board from rays (n, 3) to its corners (n, 3), which lie in its plane z = 0.

    Returns:
        (3, 3) cam_from_board and the board's origin (3,) in the camera frame.

    Raises:
        numpy.linalg.LinAlgError: The corners lie on a line.
    """
    centre = corners_m[:, :2].mean(axis=0)
    scale = float(np.abs(corners_m[:, :2] - centre).max())
    flat = np.column_stack([(corners_m[:, :2] - centre) / scale, np.ones(len(corners_m))])
    # ray x (H X) = 0: three rows a corner, two of them independent.
    zero = np.zeros_like(flat)
    x, y, z = rays[:, 0:1], rays[:, 1:2], rays[:, 2:3]
    rows = np.concatenate(
        [
            np.hstack([zero, -z * flat, y * flat]),
            np.hstack([z * flat, zero, -x * flat]),
            np.hstack([-y * flat, x * flat, zero]),
        ]
    )
    h = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 3)
    if float(np.sum((flat @ h.T) * rays)) < 0:
        h = -h
    h = h / np.sqrt(np.linalg.norm(h[:, 0]) * np.linalg.norm(h[:, 1]))
    u, _, vt = np.linalg.svd(np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])]))
    rotation: Array = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    t: Array = h[:, 2] * scale - rotation[:, :2] @ centre
    return rotation, t


def start_poses(views: Sequence[View], model: Model, parameters: Array) -> Poses | None:
    """Poses of the views before a lens; None if it can't see a corner or a view has no pose."""
    bundle = Bundle.of(views)
    rays = model.lens(parameters).rays(bundle.px)
    if not np.isfinite(rays).all():
        return None
    ends = [*bundle.start[1:], len(rays)]
    try:
        found = [pose_from_rays(v.corners_m, rays[a:b]) for v, a, b in zip(views, bundle.start, ends, strict=True)]
    except np.linalg.LinAlgError:
        return None
    return Poses(np.array([r for r, _ in found]), np.array([t for _, t in found]))


def first_fit(views: Sequence[View], model: Model) -> Fitted:
    """Fit a lens without anything to start from.

    Raises:
        CalibrationError: No focal length gives a start, or the views don't determine the lens.
    """
    few = [views[i] for i in np.unique(np.linspace(0, len(views) - 1, TRIED_VIEWS).astype(np.int64))]
    bundle = Bundle.of(few)
    tried: list[tuple[float, float]] = []
    for part in FOCAL_PARTS[model.name]:
        focal = float(part) * model.size_px[0]
        plain = model.plain(focal)
        poses = start_poses(few, model, plain)
        if poses is None:
            continue
        px, valid = model.lens(plain).project(bundle.in_camera(poses))
        if valid.all():
            tried.append((float(np.median(np.linalg.norm(bundle.px - px, axis=1))), focal))
    best: Fitted | None = None
    for _, focal in sorted(tried)[:BEST]:
        found = _fit_from(few, model, model.plain(focal))
        if found is not None and (best is None or found.sigma_px < best.sigma_px):
            best = found
    if best is not None and len(few) < len(views):
        best = _fit_from(views, model, best.parameters) or _fit_from(views, model, model.plain(best.parameters[0]))
    if best is None:
        raise CalibrationError("no lens fits the views", "see that board and --model are what they are")
    return best


def _fit_from(views: Sequence[View], model: Model, parameters: Array) -> Fitted | None:
    """A fit that starts with these parameters (p,); None if there is none."""
    poses = start_poses(views, model, parameters)
    try:
        return None if poses is None else fit(views, model, parameters, poses)
    except CalibrationError:
        return None
