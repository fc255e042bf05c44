"""Is a calibration good enough to fly with? Each question has a figure, named limits, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from app.calibration.lens import LensCalibration
from app.frames import Array
from app.vision.camera_model import tangent_basis

VIEWS = (15, 10)
"""Good from, usable from."""
COVERED = (0.85, 0.65)
"""Part of the lit cells that hold corners."""
EDGE_COVERED = (0.6, 0.25)
"""The same for the outermost cells along each edge, where distortion is strongest."""
TILT_DEG = (35.0, 18.0)
"""From the board's tilt to one side to that to the other, about each axis; the outermost tenth of views left out."""
SCALES = (1.5, 1.2)
"""Largest over smallest board in the images."""
ERROR_PX = (0.35, 0.8)
"""Root mean square of the corners' distances, for images of up to WIDTH_PX; wider ones in proportion."""
HELD_OUT = (1.25, 1.6)
"""Held-out error over that of the fit."""
PLACE_PX = (0.4, 1.2)
"""Uncertainty of a direction's pixel, at worst in the lit part. 1.2 px of 640 are 0.25% of a distance near the edge."""
DROPPED = (0.15, 0.34)
"""Part of the views that were left out because they did not fit."""
STRETCH = (0.01, 0.05)
"""fx over fy, less 1: square pixels have none."""
OFF_CENTRE = (0.06, 0.15)
"""Principal point from the image's middle, in image widths."""
WIDTH_PX = 1000


class Verdict(IntEnum):
    """From best to worst."""

    GOOD = 0
    USABLE = 1
    NOT_GOOD = 2

    @property
    def words(self) -> str:
        """For people."""
        return ("good", "usable", "not good")[self]


@dataclass(frozen=True, slots=True)
class Check:
    """One question and its answer.

    Attributes:
        name: Of the question.
        figure: The answer.
        limits: Good and usable, in words.
        verdict: What that means.
        advice: What to do, as an imperative; empty where all is well.
    """

    name: str
    figure: str
    limits: str
    verdict: Verdict
    advice: str = ""


def at_least(name: str, value: float, limits: tuple[float, float], form: str, advice: str) -> Check:
    """A check of a figure that should be large; form: how to write it."""
    verdict = _verdict(value >= limits[0], value >= limits[1])
    words = f"good from {form.format(limits[0])}, usable from {form.format(limits[1])}"
    return Check(name, form.format(value), words, verdict, "" if verdict is Verdict.GOOD else advice)


def at_most(name: str, value: float, limits: tuple[float, float], form: str, advice: str) -> Check:
    """A check of a figure that should be small."""
    verdict = _verdict(value <= limits[0], value <= limits[1])
    words = f"good up to {form.format(limits[0])}, usable up to {form.format(limits[1])}"
    return Check(name, form.format(value), words, verdict, "" if verdict is Verdict.GOOD else advice)


def _verdict(good: bool, usable: bool) -> Verdict:
    return Verdict.GOOD if good else Verdict.USABLE if usable else Verdict.NOT_GOOD


def overall(checks: Sequence[Check]) -> Verdict:
    """The worst of all."""
    return max((check.verdict for check in checks), default=Verdict.GOOD)


def covered_cells(calibration: LensCalibration, cell_corners: int) -> NDArray[np.bool_]:
    """(rows, columns) cells with at least so many corners."""
    result: NDArray[np.bool_] = (
        calibration.grid.counts(np.concatenate([v.px for v in calibration.used])) >= cell_corners
    )
    return result


def coverage_checks(covered: NDArray[np.bool_], lit: NDArray[np.bool_]) -> list[Check]:
    """Of the whole image and of its edges; both arrays are (rows, columns) of the grid."""
    checks = [
        at_least(
            "coverage",
            _part(covered, lit),
            COVERED,
            "{:.0%}",
            "hold the board where the coverage shows gaps",
        )
    ]
    sides = (
        ("left", covered[:, 0], lit[:, 0]),
        ("right", covered[:, -1], lit[:, -1]),
        ("upper", covered[0], lit[0]),
        ("lower", covered[-1], lit[-1]),
    )
    for side, held, seen in sides:
        if seen.sum() >= 2:
            part = _part(held, seen)
            checks.append(at_least(f"{side} edge", part, EDGE_COVERED, "{:.0%}", f"fill the {side} edge of the image"))
    return checks


def _part(covered: NDArray[np.bool_], lit: NDArray[np.bool_]) -> float:
    return float((covered & lit).sum() / max(1, lit.sum()))


def tilts_deg(calibration: LensCalibration) -> Array:
    """(v, 2) tilt of the board about the image's down and right axes.

    Through a pinhole lens against the image plane: a board parallel to it says nothing of the focal length. Through a
    fisheye against the line of sight.
    """
    poses = calibration.fitted.poses
    normals = poses.rotation[:, :, 2]
    if calibration.fitted.model.name == "equidistant":
        middles = [v.corners_m.mean(axis=0) for v in calibration.used]
        sight = [r @ m + t for r, m, t in zip(poses.rotation, middles, poses.t_m, strict=True)]
        normals = np.array([tangent_basis(s) @ n for s, n in zip(sight, normals, strict=True)])
    normals = normals * np.where(normals[:, 2:] < 0, -1.0, 1.0)
    result: Array = np.degrees(np.arctan2(normals[:, :2], normals[:, 2:]))
    return result


def scales(calibration: LensCalibration) -> Array:
    """(v,) size of a square in the images, relative to the image's width."""
    return np.array([v.spacing_px / v.size_px[0] for v in calibration.used])


def judge_lens(
    calibration: LensCalibration, covered: NDArray[np.bool_], lit: NDArray[np.bool_], offered: int
) -> list[Check]:
    """All questions to a lens calibration.

    Args:
        calibration: What was fitted.
        covered: (rows, columns) cells of its grid with corners.
        lit: (rows, columns) cells in which the lens gives light.
        offered: Views that the fit was given, those that it dropped included.
    """
    fitted = calibration.fitted
    width = fitted.model.size_px[0]
    fine = max(1.0, width / WIDTH_PX)
    error = (ERROR_PX[0] * fine, ERROR_PX[1] * fine)
    place = (PLACE_PX[0] * fine, PLACE_PX[1] * fine)
    tilt = np.percentile(tilts_deg(calibration), [5.0, 95.0], axis=0)
    size = np.percentile(scales(calibration), [5.0, 95.0])
    blurred = "see that the board is flat and stiff, the light good, and hold it still (a rolling shutter bends it)"
    checks = [
        at_least("views", len(calibration.used), VIEWS, "{:.0f}", "record more views of the board"),
        *coverage_checks(covered, lit),
        at_least(
            "tilt to left and right",
            float(tilt[1, 0] - tilt[0, 0]),
            TILT_DEG,
            "{:.0f} deg",
            "tilt the board more, its left side and then its right side towards the camera",
        ),
        at_least(
            "tilt up and down",
            float(tilt[1, 1] - tilt[0, 1]),
            TILT_DEG,
            "{:.0f} deg",
            "tilt the board more, its upper side and then its lower side towards the camera",
        ),
        at_least(
            "near and far", float(size[1] / size[0]), SCALES, "{:.2f}", "hold the board nearer, and further away too"
        ),
        at_most("error (rms)", fitted.total_rms_px, error, "{:.2f} px", blurred),
        at_most(
            "held-out error over it",
            calibration.held_out_rms_px / max(fitted.total_rms_px, 1e-9),
            HELD_OUT,
            "{:.2f}",
            "record more views, tilted and all over the image",
        ),
        at_most(
            "uncertainty of a pixel",
            float(np.max(calibration.place_sigma_px[lit], initial=0.0)),
            place,
            "{:.2f} px",
            "record more views where the picture of the uncertainty is worst, mostly near edges and corners",
        ),
        at_most("views that don't fit", 1.0 - len(calibration.used) / offered, DROPPED, "{:.0%}", blurred),
    ]
    return [*checks, *_shape_checks(calibration, lit)]


def _shape_checks(calibration: LensCalibration, lit: NDArray[np.bool_]) -> list[Check]:
    """Is this a lens that can be?"""
    model, parameters = calibration.fitted.model, calibration.fitted.parameters
    width, height = model.size_px
    stretch = abs(parameters[0] / parameters[1] - 1.0)
    off = math.hypot(parameters[2] - (width - 1) / 2, parameters[3] - (height - 1) / 2) / width
    rays = np.isfinite(calibration.lens.rays(calibration.grid.centres_px())).all(axis=1).reshape(lit.shape)
    blind = int((lit & ~rays).sum())
    other = "equidistant (--model fisheye)" if model.name == "pinhole" else "pinhole"
    return [
        at_most(
            "cells without a direction",
            float(blind),
            (0.0, 0.0),
            "{:.0f}",
            f"fill the edges of the image, or try the {other} model: this distortion folds back inside the image",
        ),
        at_most(
            "fx against fy",
            stretch,
            STRETCH,
            "{:.1%}",
            "see that the camera does not stretch its image to another aspect ratio",
        ),
        at_most(
            "principal point off middle (of width)",
            off,
            OFF_CENTRE,
            "{:.0%}",
            "tilt the board more in all directions, and see that the camera does not crop its image to one side",
        ),
    ]
