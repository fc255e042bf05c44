"""What a flight came to: outcome, touchdown against the simulator's truth, times, rates, latencies. Pure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import RecorderError
from app.frames import Array
from app.review.flight import Flight

RESTING = frozenset({"idle", "hold"})
"""Phases in which nothing is under way."""


def read_truth(path: Path) -> list[dict[str, Any]]:
    """The lines of a simulator's log of the truth; a last line that was cut off is left out.

    Raises:
        RecorderError: It can't be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as fault:
        raise RecorderError(f"{path}: can't be read ({fault.strerror})", "fly again") from None
    lines = []
    for line in text.splitlines():
        try:
            lines.append(json.loads(line))
        except ValueError:
            break
    return lines


def _percentiles(values: Array, *names: str) -> dict[str, float | None]:
    """{"p50": ..., "p99": ...} of some values; None where there are none."""
    return {name: (float(np.percentile(values, float(name[1:]))) if len(values) else None) for name in names}


def _last(truth: list[dict[str, Any]], kind: str) -> dict[str, Any] | None:
    found = [line for line in truth if line["kind"] == kind]
    return found[-1] if found else None


def _outcome(flight: Flight, truth: list[dict[str, Any]], ended: str) -> tuple[str, str]:
    """("landed" | "crashed" | "missed the pad" | how it was cut short | the phase it ended in, why)."""
    crash = _last(truth, "crash")
    if crash is not None:
        return "crashed", str(crash["detail"])
    if not flight.phases:
        return "not flown", ""
    _, phase, reason = flight.phases[-1]
    landed = [entry for entry in flight.phases if entry[1] == "landed"]
    if not landed:
        cut_short = ended != "over" and phase not in RESTING
        return (ended, reason) if cut_short else (phase, reason)
    start, touchdown, rest = _last(truth, "start"), _last(truth, "touchdown"), _last(truth, "rest")
    # Under PX4's own simulator the ground stands still: a vehicle that landed on a moving pad is left behind by it.
    where = touchdown if start is not None and start["vehicle"] == "px4" else rest or touchdown
    if where is not None and not where["on_deck"]:
        return "missed the pad", f"came down {where['error_m']:.2f} m from its centre"
    return "landed", landed[-1][2]


def summarise(
    name: str, flight: Flight, truth: list[dict[str, Any]], *, ended: str = "over", **more: Any
) -> dict[str, Any]:
    """One experiment's entry of result.json.

    Args:
        name: Of the experiment.
        flight: What was recorded.
        truth: The simulator's log, read after the flight; empty for a flight in the real world.
        ended: "over", or what cut the flying short: the outcome of a flight that was under way then.
        more: Further figures to carry along.
    """
    outcome, reason = _outcome(flight, truth, ended)
    # A contact counts as a touchdown again only after a climb, so the last one is the one that ended the flight.
    touchdown, rest = _last(truth, "touchdown"), _last(truth, "rest")
    start_s, end_s = flight.window_s()
    within = (flight.turn_t_s >= start_s) & (flight.turn_t_s <= end_s) & (flight.turn_sent > 0)
    tracked = _tracked(flight)
    start = next((line for line in truth if line["kind"] == "start"), {})
    return {
        "name": name,
        "outcome": outcome,
        "reason": reason,
        "seed": start.get("seed"),
        "touchdown_error_m": None if touchdown is None else touchdown["error_m"],
        "touchdown_speed_m_s": None if touchdown is None else touchdown["relative_speed_m_s"],
        "touchdown_sink_m_s": None if touchdown is None else touchdown["sink_m_s"],
        "rest_error_m": None if rest is None else rest["error_m"],
        "time_in_state_s": {phase: round(time_s, 2) for phase, time_s in flight.time_in_state_s().items()},
        "detection_rate": float(tracked.mean()) if len(tracked) else None,
        "detection_ms": _percentiles(flight.detection_ms, "p50", "p95"),
        "latency_s": _percentiles(flight.latency_s, "p50", "p99"),
        "setpoint_period_s": _percentiles(flight.turn_period_s[within], "p50", "p99"),
        "frames_seen": len(flight.detection_t_s),
        **more,
    }


def _tracked(flight: Flight) -> Array:
    """Whether the landmark was found, for each frame between its first sight and the touchdown (or the flight's end).

    On the pad the camera is blind: what it sees there says nothing about the detector.
    """
    if not flight.detected.any():
        return np.zeros(0)
    first_s = flight.detection_t_s[np.argmax(flight.detected > 0)]
    _, end_s = flight.window_s()
    end_s = min(end_s, flight.contact_s or end_s)
    chosen: Array = flight.detected[(flight.detection_t_s >= first_s) & (flight.detection_t_s <= end_s)]
    return chosen
