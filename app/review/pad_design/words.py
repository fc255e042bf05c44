"""A design in words: the table of heights for people, and the same as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

from app.errors import LandmarkError
from app.review.pad_design.proposal import Design
from app.review.pad_design.runs import Run, all_runs, settles_heading
from app.review.printing.sheet import lay_out
from app.review.printing.tiles import PAPERS_MM, tile


def contour_names(design: Design, run: Run) -> str:
    """A run's contours by their names, such as "S1 S2 T3"."""
    return " ".join(c.name for c in design.landmark.contours[run.first : run.first + run.length])


def length_words(length_m: float) -> str:
    """A height with as many digits as are worth saying."""
    return (
        f"{length_m:.1f} m" if length_m >= 10 else f"{length_m:.2f} m" if length_m >= 1 else f"{length_m * 100:.1f} cm"
    )


def to_text(design: Design, camera: str, short: Sequence[str], advice: Sequence[str]) -> str:
    """The table for people.

    Args:
        design: What to tell.
        camera: Name of the camera.
        short: What it falls short of.
        advice: What would do instead.
    """
    view, request, landmark = design.view, design.request, design.landmark
    low, high = design.spans[0]
    lines = [
        f"{'pad' if design.is_met else 'nearest pad'}: {landmark.name}, {len(design.specs)} contours, code "
        f"{landmark.code}, side {landmark.size_m * 100:.4g} cm, quiet zone {landmark.quiet_zone_m * 100:.4g} cm",
        f"for heights of {request.floor_m:g} m to {request.ceiling_m:g} m through {camera} "
        f"({math.degrees(view.half_angle_rad):.0f} deg to each side, {view.scale_px:.0f} px for 1 m at 1 m),",
        f"with a tilt of up to {math.degrees(view.tilt_rad):g} deg, any heading, and up to {view.offset * 100:g}% of "
        "the view off the middle",
        "",
        *_table(design),
        "",
        f"seen without a break from {length_words(low)} to {length_words(high)} (of the camera above the pad)",
        *_breaks(design),
        f"finest line to print: {design.pad.detail_m * 1000:.2g} mm",
        f"prints on: {_pages(design)}",
    ]
    if short:
        lines += ["", *(f"not met: {words}" for words in short), *(f"what would do: {words}" for words in advice)]
    return "\n".join(lines)


def _table(design: Design) -> list[str]:
    """A line for each working run."""
    rows = [("contours in view", "code", "from", "to", "side at that height")]
    for run in design.runs:
        names = contour_names(design, run)
        if not run.is_seen:
            rows.append((names, run.code, "never", "", ""))
            continue
        px = design.view.scale_px * design.pad.sides_m[run.first] / run.to_m
        rows.append((names, run.code, length_words(run.from_m), length_words(run.to_m), f"{px:.0f} px"))
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    return [
        "  ".join(
            word.rjust(width) if k >= 2 else word.ljust(width)
            for k, (word, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _breaks(design: Design) -> list[str]:
    return [
        f"break: between {length_words(below[1])} and {length_words(above[0])} no run is seen for sure"
        for above, below in zip(design.spans, design.spans[1:], strict=False)
    ]


def _pages(design: Design) -> str:
    """How many pages of which paper."""
    sheet = lay_out(design.landmark)
    words: list[str] = []
    for paper in PAPERS_MM:
        try:
            count = len(tile(sheet, paper, design.landmark.name))
        except LandmarkError:
            continue
        words.append(f"{count} page{'s' if count > 1 else ''} of {paper}")
    return ", ".join(words) if words else "a plotter: it is too large for pages (draw it as .svg, whole)"


def to_json(design: Design, camera: str, short: Sequence[str], advice: Sequence[str]) -> str:
    """All of it, for programs: lengths in metres unless the key says otherwise."""
    view, request, landmark = design.view, design.request, design.landmark
    runs = all_runs(design.pad, view, request.min_side_px)
    working = {(run.first, run.length) for run in design.runs}
    found = {
        "met": design.is_met,
        "camera": camera,
        "ceiling_m": request.ceiling_m,
        "floor_m": request.floor_m,
        "name": landmark.name,
        "code": landmark.code,
        "size_cm": round(landmark.size_m * 100, 5),
        "quiet_zone_cm": round(landmark.quiet_zone_m * 100, 5),
        "contours": [
            {"name": c.name, "side_cm": round(c.side_m * 100, 4), "area_ratio": spec.area_ratio}
            for c, spec in zip(landmark.contours, design.specs, strict=True)
        ],
        "covered_m": [[round(low, 4), round(high, 3)] for low, high in design.spans],
        "runs": [
            {
                "contours": contour_names(design, run).split(),
                "code": run.code,
                "from_m": round(run.from_m, 4),
                "to_m": round(run.to_m, 4) if run.is_seen else None,
                "settles_heading": settles_heading(run.code),
                "shortest_that_does": (run.first, run.length) in working,
            }
            for run in runs
        ],
        "finest_line_mm": round(design.pad.detail_m * 1000, 3),
        "farthest_m": round(design.spans[0][1], 3),
        "not_met": list(short),
        "what_would_do": list(advice),
    }
    return json.dumps(found)
