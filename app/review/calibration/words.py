"""A calibration in words: the lines that a person reads in the terminal."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.calibration.board import NoView
from app.calibration.heights import HeightCalibration
from app.calibration.judgement import Check, Verdict, overall
from app.calibration.lens import LensCalibration
from app.calibration.parameters import NAMES


def refused_lines(refused: Sequence[NoView], shown: int = 6) -> list[str]:
    """How many were refused for which reason, with the names of the first."""
    kinds: dict[str, list[NoView]] = {}
    for item in refused:
        kinds.setdefault(re.split(r"[:\d]", item.reason, maxsplit=1)[0].strip() or item.reason, []).append(item)
    counts = Counter({kind: len(items) for kind, items in kinds.items()})
    lines = []
    for kind, count in counts.most_common():
        first = kinds[kind][0]
        if count <= shown and kind != "adds nothing to":
            lines += [f"  refused {item.name}: {item.reason}" for item in kinds[kind]]
        else:
            lines.append(f"  refused {count}: {kind} ... (such as {first.name}: {first.reason})")
    return lines


def coverage_lines(counts: NDArray[np.int64], lit: NDArray[np.bool_]) -> list[str]:
    """The image as a grid of the corners seen in each cell: "." for none, a blank where the lens gives no light."""
    width = max(3, len(str(int(counts.max(initial=0)))) + 1)
    lines = []
    for row, seen in zip(counts, lit, strict=True):
        cells = [str(int(count)) if count else "." if light else " " for count, light in zip(row, seen, strict=True)]
        lines.append("  |" + "".join(cell.rjust(width) for cell in cells) + " |")
    edge = "  +" + "-" * (width * counts.shape[1] + 1) + "+"
    return [edge, *lines, edge]


def lens_lines(calibration: LensCalibration) -> list[str]:
    """Parameters with their uncertainty, and the errors."""
    fitted = calibration.fitted
    lines = []
    for name, value, sigma in zip(NAMES[fitted.model.name], fitted.parameters, calibration.deviation, strict=True):
        if name in fitted.model.held:
            lines.append(f"  {name} = 0 (the data do not ask for it)")
        elif name.startswith(("f", "c")):
            lines.append(f"  {name} = {value:.2f} +- {sigma:.2f} px")
        else:
            lines.append(f"  {name} = {value:+.5f} +- {sigma:.5f}")
    distance = np.linalg.norm(fitted.residuals_px, axis=1)
    half, most, all_but = np.percentile(distance, [50.0, 90.0, 99.0])
    lines.append(
        f"  error: rms {fitted.total_rms_px:.3f} px; half of the corners under {half:.3f}, 90% under {most:.3f}, "
        f"99% under {all_but:.3f}; views {fitted.rms_px.min():.3f} to {fitted.rms_px.max():.3f}"
    )
    lines.append(f"  error of views that the fit did not see: rms {calibration.held_out_rms_px:.3f} px")
    return lines


def view_lines(calibration: LensCalibration) -> list[str]:
    """One line a view that was used: name, corners, error, held-out error, blur."""
    items = zip(calibration.used, calibration.fitted.rms_px, calibration.held_out_px, strict=True)
    return [
        f"  used {view.name}: {len(view.px)} corners, error {rms:.3f} px, held out {held:.3f} px, "
        f"edges {view.blur_px:.1f} px"
        for view, rms, held in sorted(items, key=lambda item: -float(item[1]))
    ]


def height_lines(calibration: HeightCalibration) -> list[str]:
    """The table, row by row, against the law and the lens."""
    lines = ["  height m   L1 px (frames)   L2 px (frames)   off the 1/H law   lens says px"]
    for row in calibration.rows:
        law = calibration.law_px(row.height_m)
        off = max((row.centred_px / law - 1.0, row.offset_px / law - 1.0), key=abs)
        lines.append(
            f"  {row.height_m:8.3f}   {row.centred_px:7.2f} ({row.frames[0]:4d})   {row.offset_px:7.2f} "
            f"({row.frames[1]:4d})   {off:+15.1%}   {calibration.computed_px(row.height_m):12.2f}"
        )
    sign = "+" if calibration.law_zero_m >= 0 else "-"
    lines.append(
        f"  the law: L = {calibration.law_focal_px:.1f} px x {calibration.side_m:.4f} m / "
        f"(H {sign} {abs(calibration.law_zero_m):.4f} m); the lens file's focal length is {calibration.focal_px:.1f} px"
    )
    if calibration.centred_only:
        lines.append("  no second group: L2 is taken to be L1, as through a perfect lens")
    else:
        lines.append(f"  D = {calibration.offset_distance_px:.1f} px")
    return lines


def judgement_lines(checks: Sequence[Check]) -> list[str]:
    """Every check with its limits, then what to do, worst first."""
    name = max(len(check.name) for check in checks)
    figure = max(len(check.figure) for check in checks)
    lines = [
        f"  {check.verdict.words:<8}  {check.name:<{name}}  {check.figure:>{figure}}  ({check.limits})"
        for check in checks
    ]
    verdict = overall(checks)
    lines.append(f"judgement: {verdict.words}")
    seen: set[str] = set()
    for check in sorted(checks, key=lambda check: -check.verdict):
        if check.verdict is not Verdict.GOOD and check.advice and check.advice not in seen:
            seen.add(check.advice)
            lines.append(f"  {check.name} {check.verdict.words}: {check.advice}")
    return lines
