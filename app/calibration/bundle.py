"""The fit: a lens and the pose of the board in every view, such that all corners come to lie where they were seen.

Levenberg-Marquardt on all of them together; the poses are eliminated from the normal equations view by view (Schur
complement; Triggs et al., "Bundle adjustment: a modern synthesis", 2000). Residuals beyond HUBER sigma count linearly
(Huber, 1964), so a few wrong corners pull little. Angles over 90 degrees from the axis are as good as others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from app.calibration.board import Indices, View
from app.calibration.parameters import Model, parameter_jacobian
from app.errors import CalibrationError
from app.frames import Array

HUBER = 2.5
"""In robust sigmas of a coordinate."""
SIGMA_MIN_PX = 0.02
"""Corners are never known better: keeps the fit of a perfect drawing from weighing rounding."""
ROUNDS = 3
"""Of setting the scale of Huber's loss anew."""
STEPS_MAX = 60
CONVERGED = 1e-7
"""Relative fall of the cost, below which a round has ended."""
DAMPING_MAX = 1e9


@dataclass(frozen=True, slots=True)
class Poses:
    """Where the board is in each view.

    Attributes:
        rotation: (v, 3, 3) cam_from_board.
        t_m: (v, 3) the board's origin in the camera frame.
    """

    rotation: Array
    t_m: Array


@dataclass(frozen=True, slots=True)
class Bundle:
    """The corners of several views in a row.

    Attributes:
        corners_m: (n, 3) in the board's frame.
        px: (n, 2) seen.
        view: (n,) which view each belongs to.
        start: (v,) where each view begins.
    """

    corners_m: Array
    px: Array
    view: Indices
    start: Indices

    @classmethod
    def of(cls, views: Sequence[View]) -> Bundle:
        """The corners of views."""
        counts = np.array([len(v.px) for v in views])
        return cls(
            np.concatenate([v.corners_m for v in views]),
            np.concatenate([v.px for v in views]),
            np.repeat(np.arange(len(views)), counts),
            np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
        )

    def in_camera(self, poses: Poses) -> Array:
        """(n, 3) corners in the camera frame."""
        result: Array = np.einsum("nij,nj->ni", poses.rotation[self.view], self.corners_m) + poses.t_m[self.view]
        return result


@dataclass(frozen=True, slots=True)
class Fitted:
    """What a fit came to.

    Attributes:
        model: What was fitted.
        parameters: (p,).
        poses: Of the views.
        residuals_px: (n, 2) seen less predicted, in the order of the views' corners.
        rms_px: (v,) of each view: root mean square distance of its corners from where they should be.
        sigma_px: Robust standard deviation of a coordinate.
        covariance: (p, p) of the parameters; zero where held.
    """

    model: Model
    parameters: Array
    poses: Poses
    residuals_px: Array
    rms_px: Array
    sigma_px: float
    covariance: Array

    @property
    def total_rms_px(self) -> float:
        """Root mean square distance of all corners."""
        return math.sqrt(float(np.mean(np.sum(self.residuals_px**2, axis=1))))


def fit(views: Sequence[View], model: Model, parameters: Array, poses: Poses, *, lens_known: bool = False) -> Fitted:
    """Fit lens and poses, or the poses alone to a lens that is known.

    Args:
        views: With at least 4 corners each.
        model: What to fit.
        parameters: (p,) to start from; what the model holds must be zero.
        poses: To start from.
        lens_known: The parameters stay as they are.

    Raises:
        CalibrationError: The start is so wrong that corners are behind the lens, or the views don't determine
            the parameters.
    """
    bundle = Bundle.of(views)
    free = model.free[:0] if lens_known else model.free
    state = (parameters.astype(np.float64), poses)
    residuals = _residuals(bundle, model, *state)
    if residuals is None:
        raise CalibrationError(
            "the fit has no start: corners lie where the lens can't see", "give more views near the middle"
        )
    sigma = SIGMA_MIN_PX
    for _ in range(ROUNDS):
        sigma = max(SIGMA_MIN_PX, 1.4826 * float(np.median(np.abs(residuals))))
        state, residuals = _descend(bundle, model, free, state, residuals, HUBER * sigma)
    squares = np.add.reduceat(np.sum(residuals**2, axis=1), bundle.start)
    rms = np.sqrt(squares / np.bincount(bundle.view))
    covariance = np.zeros((len(parameters), len(parameters)))
    if len(free):
        # Robust weights lessen the sum; the scale comes from the median, corrected for the parameters spent.
        spent = len(free) + 6 * len(views)
        scale = 2 * len(bundle.px) / max(1, 2 * len(bundle.px) - spent)
        normal = _normal(bundle, model, free, state, residuals, HUBER * sigma)
        covariance[np.ix_(free, free)] = sigma**2 * scale * _inverse(normal.reduced(0.0)[0])
    return Fitted(model, state[0], state[1], residuals, rms, sigma, covariance)


def _residuals(bundle: Bundle, model: Model, parameters: Array, poses: Poses) -> Array | None:
    """(n, 2) seen less predicted; None if a corner lies where the lens can't see."""
    if min(parameters[0], parameters[1]) <= 0 or not np.isfinite(parameters).all():
        return None
    px, valid = model.lens(parameters).project(bundle.in_camera(poses))
    if not valid.all():
        return None
    return bundle.px - px


def _weights(residuals: Array, limit: float) -> Array:
    """(n,) Huber's weights."""
    distance = np.linalg.norm(residuals, axis=1)
    result: Array = np.minimum(1.0, limit / np.maximum(distance, 1e-12))
    return result


def _cost(residuals: Array, limit: float) -> float:
    distance = np.linalg.norm(residuals, axis=1)
    return float(np.sum(np.where(distance <= limit, 0.5 * distance**2, limit * (distance - 0.5 * limit))))


@dataclass(frozen=True, slots=True)
class _Normal:
    """Normal equations in blocks: a of the parameters, b between them and the poses, w of each pose."""

    a: Array
    b: Array
    w: Array
    a_right: Array
    w_right: Array

    def reduced(self, damping: float) -> tuple[Array, Array, Array, Array]:
        """Schur complement, its right side, and what gives the poses' part back: w^-1 b, w^-1 w_right."""
        a, w = _damped(self.a, damping), _damped(self.w, damping)
        w_b = np.asarray(np.linalg.solve(w, self.b), dtype=np.float64)
        w_r = np.asarray(np.linalg.solve(w, self.w_right[..., None])[..., 0], dtype=np.float64)
        left: Array = a - np.einsum("vip,viq->pq", self.b, w_b)
        right: Array = self.a_right - np.einsum("vip,vi->p", self.b, w_r)
        return left, right, w_b, w_r


def _damped(blocks: Array, damping: float) -> Array:
    result = blocks.copy()
    i = np.arange(blocks.shape[-1])
    result[..., i, i] *= 1.0 + damping
    return result


def _normal(
    bundle: Bundle, model: Model, free: Indices, state: tuple[Array, Poses], residuals: Array, limit: float
) -> _Normal:
    parameters, poses = state
    points = bundle.in_camera(poses)
    px, by_point, _ = model.lens(parameters).project_with_jacobian(points)
    arm = points - poses.t_m[bundle.view]
    cross = np.zeros((len(points), 3, 3))
    cross[:, [2, 0, 1], [1, 2, 0]] = -arm[:, [0, 1, 2]]
    cross[:, [1, 2, 0], [2, 0, 1]] = arm[:, [0, 1, 2]]
    # A small turn w about the camera's axes moves a point by w x arm = -[arm] w.
    by_pose = np.concatenate([by_point @ cross, by_point], axis=2)
    by_lens = parameter_jacobian(model, parameters, points, px)[:, :, free]
    weight = _weights(residuals, limit)
    weighted = by_pose * weight[:, None, None]
    lens_weighted = by_lens * weight[:, None, None]
    return _Normal(
        np.einsum("nip,niq->pq", lens_weighted, by_lens),
        np.add.reduceat(np.einsum("nij,nip->njp", weighted, by_lens), bundle.start),
        np.add.reduceat(np.einsum("nij,nik->njk", weighted, by_pose), bundle.start),
        np.einsum("nip,ni->p", lens_weighted, residuals),
        np.add.reduceat(np.einsum("nij,ni->nj", weighted, residuals), bundle.start),
    )


def _descend(
    bundle: Bundle, model: Model, free: Indices, state: tuple[Array, Poses], residuals: Array, limit: float
) -> tuple[tuple[Array, Poses], Array]:
    """Steps downhill at one scale of the loss, until they bring nothing."""
    cost, damping = _cost(residuals, limit), 1e-3
    for _ in range(STEPS_MAX):
        normal = _normal(bundle, model, free, state, residuals, limit)
        before = cost
        while damping < DAMPING_MAX:
            tried = _stepped(normal, free, state, damping)
            found = None if tried is None else _residuals(bundle, model, *tried)
            if tried is not None and found is not None and (new := _cost(found, limit)) < cost:
                state, residuals, cost, damping = tried, found, new, max(damping / 10.0, 1e-12)
                break
            damping *= 10.0
        if before - cost <= CONVERGED * before:
            break
    return state, residuals


def _stepped(normal: _Normal, free: Indices, state: tuple[Array, Poses], damping: float) -> tuple[Array, Poses] | None:
    """The state after one step; None where the equations have no solution."""
    parameters, poses = state
    try:
        reduced, right, w_b, w_r = normal.reduced(damping)
        step = np.linalg.solve(reduced, right)
    except np.linalg.LinAlgError:
        return None
    pose_step = w_r - np.einsum("vip,p->vi", w_b, step)
    if not np.isfinite(pose_step).all():
        return None
    moved = parameters.copy()
    moved[free] += step
    turns = np.array([cv2.Rodrigues(w)[0] for w in pose_step[:, :3]])
    return moved, Poses(turns @ poses.rotation, poses.t_m + pose_step[:, 3:])


def _inverse(matrix: Array) -> Array:
    """Inverse of a symmetric matrix whose rows differ by many orders of magnitude.

    Raises:
        CalibrationError: It has none.
    """
    scale = np.sqrt(np.abs(np.diag(matrix)))
    if not (scale > 0).all():
        raise CalibrationError("the views do not determine the lens", "record the board tilted, and all over the image")
    try:
        scaled = np.linalg.inv(matrix / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise CalibrationError(
            "the views do not determine the lens", "record the board tilted, and all over the image"
        ) from None
    result: Array = scaled / np.outer(scale, scale)
    return result
