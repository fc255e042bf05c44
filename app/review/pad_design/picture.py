"""A design as a picture: the pad, and beside it the heights at which each run of its contours is seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from app.errors import LandmarkError
from app.landmark import Contour
from app.review.pad_design.proposal import Design
from app.review.pad_design.words import contour_names, length_words

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # the backend is chosen first: there may be no screen
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

INK, BAR, ASKED, MISSED, LAWN = "#1d2733", "#1f4e79", "#e6f2e0", "#c8553d", "#cfd8c0"
TICKS_M = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)
INNER_SHADE = 0.09
"""Bars get lighter from the outermost contour inward by this much."""


def check_picture(path: Path) -> None:
    """Refuse a path before anything is worked out.

    Raises:
        LandmarkError: It is no .png, or its folder doesn't exist.
    """
    if path.suffix.lower() != ".png":
        raise LandmarkError(f"{path}: the drawing is a .png", f"give --draw {path.with_suffix('.png').name}")
    if not path.parent.is_dir():
        raise LandmarkError(f"{path}: no such folder ({path.parent})", "make it, or give a file in one that exists")


def draw_design(design: Design, path: Path, camera: str) -> None:
    """Draw it.

    Args:
        design: What to draw.
        path: A .png file; one that is there is replaced.
        camera: Name of the camera.

    Raises:
        LandmarkError: It can't be written.
    """
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(12, 5.2), dpi=130, layout="constrained", width_ratios=(0.8, 1.6), facecolor="white"
    )
    _draw_pad(left, design)
    _draw_heights(right, design, camera)
    try:
        figure.savefig(path)
    except OSError as fault:
        raise LandmarkError(
            f"{path}: can't be written ({fault.strerror})", "give a folder that can be written"
        ) from None
    finally:
        plt.close(figure)


def _draw_pad(axes: Any, design: Design) -> None:
    """The landmark as it is printed, forward up, with the name of each contour beside it."""
    landmark = design.landmark
    half = landmark.quiet_zone_m * 50.0
    axes.fill([-half, half, half, -half], [-half, -half, half, half], color="white", ec="#9aa58a", lw=0.8)
    for contour in landmark.contours:
        forward, across = contour.corners_m.T * 100.0
        axes.fill(across, forward, color=INK if contour.black else "white", lw=0)
    count = len(landmark.contours)
    for k, contour in enumerate(landmark.contours):
        at = half * (0.86 - 1.72 * k / max(1, count - 1))
        corner = _foremost_cm(contour)
        axes.plot([corner[0], 1.12 * half], [corner[1], at], color=MISSED, lw=0.8)
        axes.plot(*corner, ".", color=MISSED, ms=4)
        axes.text(1.16 * half, at, f"{contour.name}  {contour.side_m * 100:.3g} cm", va="center", fontsize=9, color=INK)
    axes.annotate("", (0.0, 1.2 * half), (0.0, 1.03 * half), arrowprops={"arrowstyle": "-|>", "color": "#666666"})
    axes.text(0.07 * half, 1.12 * half, "forward", fontsize=8, color="#666666", va="center")
    axes.set_xlim(-1.1 * half, 1.85 * half)
    axes.set_ylim(-1.1 * half, 1.25 * half)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(f"{landmark.name}: code {landmark.code}", color=INK)


def _foremost_cm(contour: Contour) -> tuple[float, float]:
    """(right, forward) of the foremost corner, the right one of two: from outside in they follow each other."""
    forward, across = contour.corners_m.T * 100.0
    k = int(np.argmax(forward + 1e-6 * across))
    return float(across[k]), float(forward[k])


def _draw_heights(axes: Any, design: Design, camera: str) -> None:
    """A bar for each working run on an axis of heights, before the heights that were asked for."""
    request, runs = design.request, design.runs
    axes.axvspan(request.floor_m, request.ceiling_m, color=ASKED, lw=0, zorder=0, label="asked for")
    for edge, met in ((request.floor_m, design.reaches_floor), (request.ceiling_m, design.reaches_ceiling)):
        axes.axvline(edge, color="#7a9a6a" if met else MISSED, lw=1.2, ls="--", zorder=1)
    names = []
    for row, run in enumerate(runs):
        names.append(f"{contour_names(design, run)}\n{run.code}")
        if not run.is_seen:
            axes.text(request.floor_m, row, " never", va="center", fontsize=8, color=MISSED)
            continue
        axes.barh(row, run.to_m - run.from_m, left=run.from_m, height=0.5, color=BAR, alpha=1.0 - INNER_SHADE * row)
        axes.text(run.from_m, row - 0.42, length_words(run.from_m), ha="left", va="center", fontsize=8, color=INK)
        axes.text(run.to_m, row - 0.42, length_words(run.to_m), ha="right", va="center", fontsize=8, color=INK)
    ends = [request.floor_m, request.ceiling_m, *(h for run in runs if run.is_seen for h in (run.from_m, run.to_m))]
    low, high = min(ends) / 1.3, max(ends) * 1.3
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(FixedLocator([t for t in TICKS_M if low <= t <= high]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} m"))
    axes.set_yticks(range(len(runs)), names, fontsize=9)
    axes.set_ylim(len(runs) - 0.4, -0.75)
    axes.set_xlabel("height of the camera above the pad")
    axes.grid(axis="x", alpha=0.3)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    asked = f"{request.floor_m:g} m to {request.ceiling_m:g} m asked for"
    title = f"seen through {camera}: {asked}" if design.is_met else f"seen through {camera}: {asked}, not met"
    axes.set_title(title, color=INK if design.is_met else MISSED)
