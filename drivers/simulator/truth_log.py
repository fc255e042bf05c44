"""The truth of a flight on disk, for the review after it: JSON, one object a line.

Lines: {"kind": "start", "t_s", "seed", "vehicle"}; {"kind": "state", "t_s", "pos_ned_m", "vel_ned_m_s",
"q_ned_from_body_wxyz", "pad_pos_ned_m", "pad_vel_ned_m_s", "pad_yaw_ned_rad", "armed"} at 50 Hz; {"kind":
"touchdown"|"rest"|"crash", "t_s", "on_deck", "error_m", "forward_m", "right_m", "relative_speed_m_s", "sink_m_s",
"tilt_rad", "detail"}; {"kind": "end", "t_s", ...}. Times are CLOCK_MONOTONIC; positions are of the world, whose origin
is on the ground under the vehicle's start: PX4's local frame wanders against it by its estimate's error.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

from drivers.simulator.touchdown import Contact
from drivers.simulator.world import Truth

PERIOD_S = 0.02


class TruthLog:
    """Writes the lines.

    Args:
        path: Of the file, or None for no log.
    """

    def __init__(self, path: Path | None) -> None:
        self._file: TextIO | None = path.open("w", encoding="utf-8") if path else None
        self._due_s = 0.0
        self._contacts = 0

    def start(self, t_s: float, seed: int, vehicle: str) -> None:
        """The first line."""
        self._write({"kind": "start", "t_s": t_s, "seed": seed, "vehicle": vehicle})

    def state(self, t_s: float, truth: Truth, armed: bool) -> None:
        """A state, if one is due."""
        if t_s < self._due_s:
            return
        self._due_s = t_s + PERIOD_S - 1e-4
        pad = truth.pad
        self._write(
            {
                "kind": "state",
                "t_s": round(t_s, 4),
                "pos_ned_m": [round(v, 4) for v in truth.pos],
                "vel_ned_m_s": [round(v, 4) for v in truth.vel],
                "q_ned_from_body_wxyz": [round(v, 6) for v in truth.q],
                "pad_pos_ned_m": [round(v, 4) for v in (pad.north_m, pad.east_m, pad.down_m)],
                "pad_vel_ned_m_s": [round(v, 4) for v in (pad.vel_north_m_s, pad.vel_east_m_s, 0.0)],
                "pad_yaw_ned_rad": round(pad.heading_rad, 5),
                "armed": armed,
            }
        )

    def contacts(self, origin_s: float, contacts: list[Contact]) -> None:
        """Those of a growing list that were not written yet; their times count from origin_s."""
        for contact in contacts[self._contacts :]:
            line = asdict(contact)
            line["t_s"] = origin_s + contact.t_s
            self._write(line)
            if self._file:
                self._file.flush()
        self._contacts = len(contacts)

    def close(self, t_s: float, **figures: Any) -> None:
        """The last line."""
        self._write({"kind": "end", "t_s": t_s, **figures})
        if self._file:
            self._file.close()
        self._file = None

    def _write(self, line: dict[str, Any]) -> None:
        if self._file:
            self._file.write(json.dumps(line, separators=(",", ":")) + "\n")
