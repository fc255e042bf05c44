"""From views of a board to a lens: views that don't fit are dropped, and what is left judges itself.

Held-out error: the lens is fitted without a fifth of the views and judged on that fifth, five times over. The spread of
these five lenses is the jackknife's estimate of the uncertainty (Efron, "The jackknife, the bootstrap and other
resampling plans", 1982), which sees what a covariance can't: a bent board, a rolling shutter, a wrong model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.calibration.board import NoView, View
from app.calibration.bundle import Fitted, Poses, fit
from app.calibration.coverage import Grid
from app.calibration.parameters import NAMES, STAGES, Model, ModelName, parameter_jacobian
from app.calibration.start import first_fit
from app.errors import CalibrationError
from app.frames import Array
from app.vision.camera_model import Lens

VIEWS_MIN = 6
"""Fewer leave a lens's nine numbers to chance."""
FOLDS = 5
DROP_OVER_MEDIAN = 3.0
"""A view whose error is this many times the median view's is dropped ..."""
DROP_OVER_PX = 0.15
"""... if it is above this as well."""
DROPPED_PART_MAX = 1 / 3
SIMPLER_IS_BETTER = 1.02
"""A lens with fewer coefficients is taken if its held-out error is at most this many times that of the fuller one."""


@dataclass(frozen=True, slots=True)
class LensCalibration:
    """A lens, and how well it is known.

    Attributes:
        fitted: The fit to all views that were used.
        used: These views.
        dropped: Views that were left out for their residuals, with the reason.
        held_out_px: (v,) error of each view under the lens that was fitted without it.
        deviation: (p,) standard deviation of the parameters: the larger of covariance and jackknife.
        grid: Cells over the image.
        place_sigma_px: (rows, columns) how far the pixel of a known direction may be wrong, one sigma, apart from a
            turn of the whole camera, which belongs to its mount. Where a lens with fewer coefficients was taken, what
            the fullest one says otherwise counts too: where no corner was seen, both are guesses. Infinite where some
            of the lenses see nothing.
    """

    fitted: Fitted
    used: tuple[View, ...]
    dropped: tuple[NoView, ...]
    held_out_px: Array
    deviation: Array
    grid: Grid
    place_sigma_px: Array

    @property
    def lens(self) -> Lens:
        """The lens."""
        return self.fitted.model.lens(self.fitted.parameters)

    @property
    def held_out_rms_px(self) -> float:
        """Root mean square of held_out_px."""
        return math.sqrt(float(np.mean(self.held_out_px**2)))


def calibrate_lens(views: Sequence[View], name: ModelName) -> LensCalibration:
    """Fit a lens of a kind to views of a board, all of one image size.

    Raises:
        CalibrationError: There are fewer than VIEWS_MIN, or no lens of this kind fits.
    """
    if len(views) < VIEWS_MIN:
        raise CalibrationError(
            f"{len(views)} usable view(s) of the board, at least {VIEWS_MIN} are needed",
            "record more: the board sharp, tilted, and all over the image",
        )
    stages = [Model(name, views[0].size_px, held) for held in STAGES[name]]
    fullest, used, dropped = _without_misfits(views, stages[-1])
    found = [_judged(used, fullest)]
    for model in stages[-2::-1]:
        held = [i for i, parameter in enumerate(NAMES[name]) if parameter in model.held]
        start = fullest.parameters.copy()
        start[held] = 0.0
        try:
            found.insert(0, _judged(used, fit(used, model, start, fullest.poses)))
        except CalibrationError:
            continue  # without what is held it sees too little: the fuller lens it is
    best = min(_rms(held) for _, held, _ in found)
    fitted, held_out, lenses = next(item for item in found if _rms(item[1]) <= SIMPLER_IS_BETTER * best)
    grid = Grid.over(fitted.model.size_px)
    covered = grid.counts(np.concatenate([v.px for v in used])) > 0
    jackknife = np.sqrt((len(lenses) - 1) * np.var(np.array(lenses), axis=0))
    deviation = np.maximum(np.sqrt(np.diag(fitted.covariance)), jackknife)
    return LensCalibration(
        fitted,
        tuple(used),
        tuple(dropped),
        held_out,
        deviation,
        grid,
        _place_sigma_px(fitted, lenses, fullest.parameters, grid, covered.ravel()),
    )


def _rms(values: Array) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _without_misfits(views: Sequence[View], model: Model) -> tuple[Fitted, list[View], list[NoView]]:
    """Fit, drop the view that fits worst while one stands out, and fit again."""
    used, dropped = list(views), list[NoView]()
    fitted = first_fit(used, model)
    while len(used) > VIEWS_MIN and len(dropped) < DROPPED_PART_MAX * len(views):
        usual = float(np.median(fitted.rms_px))
        limit = max(DROP_OVER_PX, DROP_OVER_MEDIAN * usual)
        out = fitted.rms_px > limit
        if not out.any():
            break
        # Several at once where they stand out clearly: one at a time takes a fit each.
        worst = fitted.rms_px >= max(limit, 0.5 * float(fitted.rms_px.max()))
        worst &= np.cumsum(worst) <= len(used) - VIEWS_MIN
        for view, rms, gone in zip(used, fitted.rms_px, worst, strict=True):
            if gone:
                words = f"does not fit: corners are {rms:.2f} px off, over {limit:.2f} (half of the views: {usual:.2f})"
                dropped.append(NoView(view.name, words))
        used = [view for view, gone in zip(used, worst, strict=True) if not gone]
        poses = Poses(fitted.poses.rotation[~worst], fitted.poses.t_m[~worst])
        fitted = fit(used, model, fitted.parameters, poses)
    return fitted, used, dropped


def _judged(used: Sequence[View], fitted: Fitted) -> tuple[Fitted, Array, list[Array]]:
    """A fit, the error of each view under a lens fitted without it, and the parameters of these lenses."""
    held_out = np.full(len(used), np.nan)
    lenses: list[Array] = []
    for k in range(FOLDS):
        out = np.arange(len(used)) % FOLDS == k
        rest = Poses(fitted.poses.rotation[~out], fitted.poses.t_m[~out])
        own = Poses(fitted.poses.rotation[out], fitted.poses.t_m[out])
        part = fit([v for v, o in zip(used, out, strict=True) if not o], fitted.model, fitted.parameters, rest)
        lenses.append(part.parameters)
        seen = [v for v, o in zip(used, out, strict=True) if o]
        try:
            held_out[out] = fit(seen, fitted.model, part.parameters, own, lens_known=True).rms_px
        except CalibrationError:  # a lens that can't even see what it was not fitted to
            held_out[out] = math.inf
    return fitted, held_out, lenses


def _place_sigma_px(
    fitted: Fitted, lenses: Sequence[Array], fullest: Array, grid: Grid, covered: NDArray[np.bool_]
) -> Array:
    """See LensCalibration.place_sigma_px; lenses: of the jackknife. The turn is the one that the covered cells show."""
    model, px = fitted.model, grid.centres_px()
    lens = model.lens(fitted.parameters)
    rays = lens.rays(px)
    seen = np.isfinite(rays).all(axis=1)
    result = np.full(len(px), math.inf)
    rays, px = rays[seen], px[seen]
    shifts = [model.lens(p).project(rays)[0] - px for p in (*lenses, fullest)]
    known = np.isfinite(shifts).all(axis=(0, 2)) if len(px) else np.zeros(0, dtype=bool)
    if known.sum() < 4:
        return result.reshape(grid.rows, grid.columns)
    rays, px = rays[known], px[known]
    _, by_point, _ = lens.project_with_jacobian(rays)
    by_turn = np.stack([np.cross(axis, rays) for axis in np.eye(3)], axis=-1)
    turn = (by_point @ by_turn).reshape(-1, 3)
    by_lens = parameter_jacobian(model, fitted.parameters, rays, px).reshape(len(turn), -1)
    weight = np.repeat(covered[seen][known].astype(np.float64), 2)
    free = np.eye(len(turn)) - turn @ np.linalg.pinv(turn * weight[:, None]) * weight
    by_lens = free @ by_lens
    covariance = np.sum((by_lens @ fitted.covariance) * by_lens, axis=1)
    *spread, other = (free @ shift[known].ravel() for shift in shifts)
    variance = np.maximum(covariance, (len(lenses) - 1) * np.var(np.array(spread), axis=0)) + other**2
    where = np.flatnonzero(seen)[known]
    result[where] = np.sqrt(variance.reshape(-1, 2).sum(axis=1))
    return result.reshape(grid.rows, grid.columns)
