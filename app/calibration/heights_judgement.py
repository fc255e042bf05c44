"""Is a height table good enough to fly with? Each question has a figure, named limits, and what to do about it."""

from __future__ import annotations

import numpy as np

from app.calibration.heights import HeightCalibration
from app.calibration.judgement import Check, Verdict, at_least, at_most

HEIGHTS = (6, 3)
"""Good from, usable from: rows of the table."""
FRAMES = (5, 1)
"""Frames of each height in each group."""
LAW = (0.015, 0.04)
"""A row's length over that of the line through 1 / L, less 1."""
FOCAL = (0.02, 0.06)
"""The focal length that the lengths speak for, over the lens's, less 1."""
ZERO_M = (0.015, 0.05)
"""Where the line through 1 / L is zero: the heights' zero against the lens."""
GROUPS = (0.05, 0.15)
"""L2 over L1, less 1. The paper's own differ by up to 12%."""
SPREAD = (0.01, 0.03)
"""Of the lengths in one row, robust standard deviation over median."""


def judge_heights(calibration: HeightCalibration) -> list[Check]:
    """All questions to a height table."""
    rows = calibration.rows
    law = [
        max(abs(length / calibration.law_px(row.height_m) - 1.0) for length in (row.centred_px, row.offset_px))
        for row in rows
    ]
    worst = rows[int(np.argmax(law))].height_m
    short = "small" if calibration.law_zero_m > 0 else "large"
    zero_cm = tuple(100.0 * limit for limit in ZERO_M)
    checks = [
        at_least("heights", len(rows), HEIGHTS, "{:.0f}", "record more heights, from the lowest to the highest"),
        at_least(
            "frames of each",
            min(min(row.frames) for row in rows),
            FRAMES,
            "{:.0f}",
            "record more frames of each height",
        ),
        at_most(
            "spread of a row",
            max(max(row.spread) for row in rows),
            SPREAD,
            "{:.1%}",
            "hold the camera still, and give sharp frames",
        ),
        _falls(calibration),
        at_most("off the 1/H law", max(law), LAW, "{:.1%}", f"measure the height of {worst:g} m again"),
        at_most(
            "focal length against the lens file's",
            abs(calibration.law_focal_px / calibration.focal_px - 1.0),
            FOCAL,
            "{:.1%}",
            "see that --camera and --pad are right, and the landmark's printed size (alight calibrate lens)",
        ),
        at_most(
            "zero of the heights",
            100.0 * abs(calibration.law_zero_m),
            (zero_cm[0], zero_cm[1]),
            "{:.1f} cm",
            "measure heights from the landmark's face to the lens: "
            f"they seem {100 * abs(calibration.law_zero_m):.1f} cm too {short}",
        ),
    ]
    if not calibration.centred_only:
        checks.append(
            at_most(
                "offset against centred",
                max(abs(row.offset_px / row.centred_px - 1.0) for row in rows),
                GROUPS,
                "{:.1%}",
                "see that the camera looked straight down, and that the camera file is right",
            )
        )
    return checks


def _falls(calibration: HeightCalibration) -> Check:
    """Do both groups' lengths fall from each height to the next?"""
    for low, high in zip(calibration.rows, calibration.rows[1:], strict=False):
        for group, a, b in (
            ("centred", low.centred_px, high.centred_px),
            ("offset", low.offset_px, high.offset_px),
        ):
            if b >= a:
                words = f"{group}: {a:.2f} px at {low.height_m:g} m, {b:.2f} px at {high.height_m:g} m"
                return Check(
                    "falls with height", words, "each below the one before", Verdict.NOT_GOOD, "measure both again"
                )
    return Check("falls with height", "yes", "each below the one before", Verdict.GOOD)
