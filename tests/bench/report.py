"""The benchmark's figures as Markdown tables, and as JSON."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from detectors import ENTRIES
from judge import Verdict, rate, summary

SEQUENCES = "sequences"
"""Name of the set of all sequences."""
Results = dict[str, dict[str, list[Verdict]]]
"""Set, detector: verdicts."""


def _number(value: float, digits: int) -> str:
    return "-" if not math.isfinite(value) else f"{value:.{digits}f}"


def _pair(values: tuple[float, float], digits: int) -> str:
    return " / ".join(_number(v, digits) for v in values)


def _table(head: list[str], rows: list[list[str]]) -> str:
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]
    lines = [" | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in [head, *rows]]
    rule = "|".join("-" * (w + 2) for w in widths)
    return "\n".join([f"| {lines[0]} |", f"|{rule}|", *(f"| {line} |" for line in lines[1:])]) + "\n"


def _rate_cell(verdicts: list[Verdict]) -> str:
    if not verdicts:
        return "-"
    wrong = sum(v.outcome == "wrong" for v in verdicts)
    return f"{rate(verdicts):.1f}" + (f" ({wrong} wrong)" if wrong else "")


def _visible(verdicts: list[Verdict]) -> list[Verdict]:
    return [v for v in verdicts if v.kind == "visible"]


def main_table(results: Results, names: list[str]) -> str:
    """Rates of every set; errors on the cone, or the first set there is; processor times."""
    ran = list(results)
    stills = [s for s in ran if s != SEQUENCES]
    of_errors = "cone" if "cone" in ran else ran[0]
    head = ["detector", *(f"{s} %" for s in ran)]
    head += [f"distance error {of_errors} p50 / p90 %", f"yaw {of_errors} p50 / p90 deg", "ms p50 / p90"]
    head += ["sequence ms p50 / p90"] if SEQUENCES in ran else []
    rows = []
    for name in names:
        row = [ENTRIES[name].title]
        for one in ran:
            verdicts = results[one].get(name, [])
            row.append(_rate_cell(_visible(verdicts) if one == SEQUENCES else verdicts))
        errors = summary(results[of_errors].get(name, []))
        times = summary([v for s in stills for v in results[s].get(name, [])])
        row += [_pair(errors["distance_percent"], 2), _pair(errors["yaw_deg"], 2), _pair(times["ms"], 2)]
        if SEQUENCES in ran:
            row.append(_pair(summary(results[SEQUENCES].get(name, []))["ms"], 2))
        rows.append(row)
    return _table(head, rows)


def kind_table(set_name: str, verdicts: dict[str, list[Verdict]], by: Callable[[Verdict], str]) -> str:
    """Rates of one set by height, kind or sequence."""
    first = next(iter(verdicts.values()))
    kinds = list(dict.fromkeys(by(v) for v in first))
    if set_name == "cone":
        kinds.sort()
    head = [set_name, "frames", *(ENTRIES[name].title for name in verdicts)]
    rows = []
    for kind in kinds:
        row = [kind, str(sum(by(v) == kind for v in first))]
        row += [_rate_cell([v for v in verdicts[name] if by(v) == kind]) for name in verdicts]
        rows.append(row)
    return _table(head, rows)


def error_table(results: Results, names: list[str]) -> str:
    """Errors and times set by set."""
    head = ["set", "detector", "distance p50 / p90 %", "bias %", "yaw p50 / p90 deg", "corner p50 / p90 px"]
    head += ["detection ms p50 / p90", "pose ms p50 / p90"]
    rows = []
    for set_name, verdicts in results.items():
        for name in names:
            if name in verdicts:
                s = summary(verdicts[name])
                rows.append(
                    [
                        set_name,
                        ENTRIES[name].title,
                        _pair(s["distance_percent"], 2),
                        _number(s["distance_bias_percent"], 2),
                        _pair(s["yaw_deg"], 2),
                        _pair(s["corner_px"], 2),
                        _pair(s["detect_ms"], 2),
                        _pair(s["pose_ms"], 2),
                    ]
                )
    return _table(head, rows)


CHI2_95 = {"place": 7.815 / 3, "pose": 12.592 / 6}
"""What 95% of honest squares a degree of freedom stay under: chi squared of 3 and 6 degrees of freedom."""
CLAIM_WORDS = "An honest covariance has 95 in the band, a mean of 1.00 and medians of 0.79 (place) and 0.89 (pose).\n"
SIDES = ((0.0, 25.0), (25.0, 60.0), (60.0, 200.0), (200.0, math.inf))
INCIDENCES = ((0.0, 15.0), (15.0, 30.0), (30.0, 90.0))
MOTIONS = ((0.0, 1.0), (1.0, 2.5), (2.5, math.inf))


def _between(name: str, limits: tuple[tuple[float, float], ...], unit: str) -> dict[str, Callable[[Verdict], bool]]:
    """A row for each stretch of a figure of the verdicts."""

    def inside(low: float, high: float) -> Callable[[Verdict], bool]:
        return lambda v: low <= getattr(v, name) < high

    words = [f"{low:g}..{high:g} {unit}" if math.isfinite(high) else f"over {low:g} {unit}" for low, high in limits]
    return {word: inside(*pair) for word, pair in zip(words, limits, strict=True)}


def claim_table(results: Results, name: str) -> str:
    """How honest a detector's covariance is: its errors as a part of it, in all frames that were right."""
    right = [v for by_name in results.values() for v in by_name.get(name, []) if v.outcome == "right"]
    right = [v for v in right if math.isfinite(v.pose_square)]
    if not right:
        return ""
    rows: dict[str, Callable[[Verdict], bool]] = {
        "stills": lambda v: not v.set_name.startswith("seq-"),
        "sequences": lambda v: v.set_name.startswith("seq-"),
        **_between("side_px", SIDES, "px side"),
        **_between("incidence_deg", INCIDENCES, "deg aslant"),
        **_between("motion_px", MOTIONS, "px of motion"),
    }
    head = [f"{ENTRIES[name].title}: error over covariance", "frames", "place, in the 95% band %", "place, mean square"]
    head += ["place, median", "pose, in the 95% band %", "pose, median"]
    cells = []
    for word, fits in rows.items():
        those = [v for v in right if fits(v)]
        place, pose = np.array([v.place_square for v in those]), np.array([v.pose_square for v in those])
        if not those:
            continue
        cells.append(
            [
                word,
                str(len(those)),
                f"{100.0 * np.mean(place < CHI2_95['place']):.0f}",
                f"{place.mean():.2f}",
                f"{np.median(place):.2f}",
                f"{100.0 * np.mean(pose < CHI2_95['pose']):.0f}",
                f"{np.median(pose):.2f}",
            ]
        )
    return _table(head, cells)


def _by_kind(verdict: Verdict) -> str:
    return verdict.kind


def _by_sequence(verdict: Verdict) -> str:
    return verdict.set_name.removeprefix("seq-")


def _machine() -> str:
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        found = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        model = found[0] if found else model
    return f"{model}, one thread, OpenCV {cv2.__version__}"


def report(results: Results, names: list[str], count: int, unseen: bool, took_s: float) -> str:
    """Everything that is printed."""
    part = "unseen" if unseen else "tuning"
    parts = [
        f"\n## Detections in % of frames ({part} part; {count} frames a set; {_machine()}; {took_s:.0f} s)\n\n",
        main_table(results, names),
    ]
    for set_name, verdicts in results.items():
        if not verdicts:  # none of the detectors follows sequences
            continue
        if set_name == SEQUENCES:
            seen = {name: _visible(vs) for name, vs in verdicts.items()}
            parts += ["\n", kind_table(SEQUENCES, seen, _by_sequence)]
        else:
            parts += ["\n", kind_table(set_name, verdicts, _by_kind)]
    parts += ["\n", error_table(results, names)]
    claims = claim_table(results, "alight")
    parts += ["\n", claims, CLAIM_WORDS] if claims else []
    return "".join(parts)


def to_json(results: Results, unseen: bool) -> dict[str, Any]:
    """Figures and every verdict."""

    def clean(value: Any) -> Any:
        if isinstance(value, float):
            return value if math.isfinite(value) else None
        if isinstance(value, dict):
            return {k: clean(v) for k, v in value.items()}
        return [clean(v) for v in value] if isinstance(value, list | tuple) else value

    sets_json = {
        set_name: {
            name: {"summary": summary(verdicts), "frames": [asdict(v) for v in verdicts]}
            for name, verdicts in by_name.items()
        }
        for set_name, by_name in results.items()
    }
    cleaned: dict[str, Any] = clean(
        {"part": "unseen" if unseen else "tuning", "machine": _machine(), "sets": sets_json}
    )
    return cleaned
