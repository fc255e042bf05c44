"""Pictures of a calibration: where corners were seen and how far off they are, how sure the lens is, the heights."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

from app.calibration.board import NoView
from app.calibration.heights import HeightCalibration
from app.calibration.lens import LensCalibration
from app.errors import CalibrationError

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # the backend is chosen first: there may be no screen

FIRST, SECOND = "#1f4e79", "#c8553d"


def draw_lens(calibration: LensCalibration, lit: NDArray[np.bool_], title: str, folder: Path) -> Path:
    """lens.png: all corners with their residuals, the uncertainty over the image, errors of corners and of views.

    Raises:
        CalibrationError: It can't be written.
    """
    fitted, grid = calibration.fitted, calibration.grid
    width, height = fitted.model.size_px
    figure, ((corners, sure), (spread, views)) = plt.subplots(
        2, 2, figsize=(13, 9.5), dpi=110, layout="constrained", gridspec_kw={"height_ratios": [3, 2]}
    )
    px = np.concatenate([v.px for v in calibration.used])
    off = fitted.residuals_px
    distance = np.linalg.norm(off, axis=1)
    longest = max(float(np.percentile(distance, 95.0)), 1e-3)
    magnified = _round_down(0.05 * width / longest)
    for k in range(1, grid.columns):
        corners.axvline(k * width / grid.columns - 0.5, color="0.88", lw=0.7)
    for k in range(1, grid.rows):
        corners.axhline(k * height / grid.rows - 0.5, color="0.88", lw=0.7)
    corners.plot(px[:, 0], px[:, 1], ".", ms=1, color="0.7")
    arrows = corners.quiver(
        px[:, 0],
        px[:, 1],
        off[:, 0] * magnified,
        off[:, 1] * magnified,
        distance,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.0022,
        cmap="viridis",
        clim=(0.0, longest),
    )
    figure.colorbar(arrows, ax=corners, label="px")
    _as_image(corners, width, height, f"corners, residuals x {magnified:g}")
    sigma = np.where(lit, calibration.place_sigma_px, np.nan)
    shown = sure.imshow(
        np.where(np.isfinite(sigma), sigma, np.nan),
        extent=(-0.5, width - 0.5, height - 0.5, -0.5),
        cmap="magma_r",
        vmin=0.0,
    )
    figure.colorbar(shown, ax=sure, label="px, one sigma")
    size = (grid.columns, grid.rows)
    for (u, v), value in zip(grid.centres_px(), sigma.ravel(), strict=True):
        words = "" if math.isnan(value) else "blind" if math.isinf(value) else f"{value:.2f}"
        dark = value > 0.5 * float(np.nanmax(np.where(np.isfinite(sigma), sigma, np.nan)))
        sure.text(u, v, words, ha="center", va="center", fontsize=8, color="white" if dark else "black")
    _as_image(sure, width, height, f"uncertainty of a direction's pixel, {size[0]} x {size[1]} cells")
    spread.hist(distance, bins=40, range=(0.0, max(4.0 * float(np.median(distance)), 1e-3)), color=FIRST)
    spread.axvline(fitted.total_rms_px, color=SECOND, lw=1, label=f"rms {fitted.total_rms_px:.3f} px")
    spread.set_xlabel("distance of a corner from where it should be, px")
    spread.set_ylabel("corners")
    spread.legend(fontsize=8)
    order = np.argsort(fitted.rms_px)
    views.plot(fitted.rms_px[order], ".", color=FIRST, label="fitted")
    views.plot(calibration.held_out_px[order], "x", ms=4, color=SECOND, label="by a fit that did not see it")
    views.set_ylim(bottom=0.0)
    views.set_xlabel("view")
    views.set_ylabel("rms, px")
    views.legend(fontsize=8)
    figure.suptitle(title)
    return _save(figure, folder / "lens.png")


def _round_down(value: float) -> float:
    """The next smaller 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * max(k for k in (1.0, 2.0, 5.0) if k * power <= value)


def _as_image(axes: Any, width: int, height: int, title: str) -> None:
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=10)


def write_views(calibration: LensCalibration, refused: Sequence[NoView], folder: Path) -> Path:
    """views.csv: each frame that was looked at, what it gave or why it was refused.

    Raises:
        CalibrationError: It can't be written.
    """
    path = folder / "views.csv"
    used = zip(calibration.used, calibration.fitted.rms_px, calibration.held_out_px, strict=True)
    rows: list[Sequence[object]] = [
        (v.name, "used", len(v.px), f"{rms:.4f}", f"{held:.4f}", f"{v.blur_px:.2f}", "") for v, rms, held in used
    ]
    rows += [(item.name, "refused", "", "", "", "", item.reason) for item in refused]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(("frame", "result", "corners", "error_px", "held_out_px", "blur_px", "reason"))
            writer.writerows(rows)
    except OSError as fault:
        raise _unwritable(path, fault) from None
    return path


def draw_heights(calibration: HeightCalibration, title: str, folder: Path) -> Path:
    """heights.png: the lengths over height with the 1/H law and what the lens says, and how far each is off the law.

    Raises:
        CalibrationError: It can't be written.
    """
    figure, (lengths, off) = plt.subplots(
        2, 1, figsize=(8, 8), dpi=110, layout="constrained", sharex=True, gridspec_kw={"height_ratios": [3, 2]}
    )
    heights = np.array([row.height_m for row in calibration.rows])
    fine = np.geomspace(heights[0] * 0.9, heights[-1] * 1.1, 200)
    law = np.array([calibration.law_px(float(h)) for h in fine])
    lengths.plot(fine, law, color="0.6", lw=1, label="1/H law through the rows")
    lengths.plot(fine, [calibration.computed_px(float(h)) for h in fine], "--", color="0.6", lw=1, label="by the lens")
    groups = [("L1, centred", FIRST, [r.centred_px for r in calibration.rows], 0)]
    if not calibration.centred_only:
        groups.append(("L2, offset", SECOND, [r.offset_px for r in calibration.rows], 1))
    for label, colour, rows, group in groups:
        mine = [sample for sample, of in calibration.samples if of == group]
        at = np.array([sample.height_m for sample in mine])
        sides = np.array([sample.side_px for sample in mine])
        lengths.plot(at, sides, ".", ms=2, color=colour, alpha=0.4)
        lengths.plot(heights, rows, "o", ms=5, mfc="none", color=colour, label=label)
        expected = np.array([calibration.law_px(float(h)) for h in at])
        off.plot(at, 100.0 * (sides / expected - 1.0), ".", ms=2, color=colour, alpha=0.4)
        expected = np.array([calibration.law_px(float(h)) for h in heights])
        off.plot(heights, 100.0 * (np.array(rows) / expected - 1.0), "o", ms=5, mfc="none", color=colour)
    computed = np.array([calibration.computed_px(float(h)) for h in fine])
    off.plot(fine, 100.0 * (computed / law - 1.0), "--", color="0.6", lw=1)
    off.axhline(0.0, color="0.6", lw=1)
    lengths.set_xscale("log")
    lengths.set_yscale("log")
    lengths.set_ylabel("longest side of the triangle, px")
    lengths.legend(fontsize=8)
    off.set_ylabel("off the law, %")
    off.set_xlabel("height, m")
    for axes in (lengths, off):
        axes.grid(alpha=0.3, which="both")
    figure.suptitle(title)
    return _save(figure, folder / "heights.png")


def _save(figure: Any, path: Path) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    except OSError as fault:
        raise _unwritable(path, fault) from None
    finally:
        plt.close(figure)
    return path


def _unwritable(path: Path, fault: OSError) -> CalibrationError:
    return CalibrationError(
        f"{path}: can't be written ({fault.strerror})", "give --draw a folder that can be written to"
    )
