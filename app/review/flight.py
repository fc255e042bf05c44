"""One flight as arrays: what the record holds, and, where a simulator flew, what it says was true. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from app.frames import Array
from app.messages import Frame
from app.review.record_reader import Recorded


@dataclass(slots=True)
class Flight:
    """What was recorded, by topic, times in seconds of the application's clock.

    Attributes:
        vehicle_t_s: (n,).
        vehicle_pos_ned_m: (n, 3).
        vehicle_vel_ned_m_s: (n, 3).
        detection_t_s: (d,) one for each frame that was looked at.
        detected: (d,) whether the landmark was found.
        detection_ms: (d,) processor time of the detection.
        fix_t_s: (f,).
        fix_height_m: (f,) height of the vehicle above the pad, by vision.
        fix_horizontal_m: (f,) distance over ground to the pad, by vision.
        turn_t_s: (c,) turns of the control loop.
        turn_period_s: (c,).
        turn_sent: (c,) whether a setpoint was sent.
        contact_s: When the controller last began to rest on something; None if it never did.
        latency_s: (l,) exposure to setpoint, one for each fix that was used.
        phases: (time entered, phase, reason) in order.
        texts: (time, line) as the phone saw them.
    """

    vehicle_t_s: Array = field(default_factory=lambda: np.zeros(0))
    vehicle_pos_ned_m: Array = field(default_factory=lambda: np.zeros((0, 3)))
    vehicle_vel_ned_m_s: Array = field(default_factory=lambda: np.zeros((0, 3)))
    detection_t_s: Array = field(default_factory=lambda: np.zeros(0))
    detected: Array = field(default_factory=lambda: np.zeros(0))
    detection_ms: Array = field(default_factory=lambda: np.zeros(0))
    fix_t_s: Array = field(default_factory=lambda: np.zeros(0))
    fix_height_m: Array = field(default_factory=lambda: np.zeros(0))
    fix_horizontal_m: Array = field(default_factory=lambda: np.zeros(0))
    turn_t_s: Array = field(default_factory=lambda: np.zeros(0))
    turn_period_s: Array = field(default_factory=lambda: np.zeros(0))
    turn_sent: Array = field(default_factory=lambda: np.zeros(0))
    contact_s: float | None = None
    latency_s: Array = field(default_factory=lambda: np.zeros(0))
    phases: list[tuple[float, str, str]] = field(default_factory=list)
    texts: list[tuple[float, str]] = field(default_factory=list)

    @property
    def end_s(self) -> float:
        """Time of the last vehicle state."""
        return float(self.vehicle_t_s[-1]) if len(self.vehicle_t_s) else 0.0

    def time_in_state_s(self) -> dict[str, float]:
        """Seconds spent in each phase that was entered after the first, in order of first entry."""
        total: dict[str, float] = {}
        ends = [t for t, _, _ in self.phases[1:]] + [max(self.end_s, self.phases[-1][0] if self.phases else 0.0)]
        for (start, phase, _), end in zip(self.phases, ends, strict=True):
            if phase != "idle":
                total[phase] = total.get(phase, 0.0) + end - start
        return total

    def window_s(self) -> tuple[float, float]:
        """From the first phase that is not idle to the end of the flying."""
        active = [t for t, phase, _ in self.phases if phase != "idle"]
        ended = [t for t, phase, _ in self.phases if phase in ("landed", "idle") and active and t > active[0]]
        start = active[0] if active else 0.0
        return start, (ended[0] if ended else self.end_s)


def collect_flight(items: Iterable[Recorded]) -> Flight:
    """Gather a record's items into arrays; images and unknown topics are left out."""
    rows: dict[str, list[Any]] = {}
    phases: list[tuple[float, str, str]] = []
    texts: list[tuple[float, str]] = []
    for topic, t_s, _, message in items:
        if isinstance(message, Frame):
            continue
        if topic == "reports":
            if not phases or phases[-1][1] != message["phase"] or phases[-1][2] != message["reason"]:
                phases.append((t_s, message["phase"], message["reason"]))
        elif topic == "texts":
            texts.append((t_s, message["text"]))
        elif topic in ("vehicle", "detections", "fixes", "turns"):
            rows.setdefault(topic, []).append((t_s, message))
    flight = Flight(phases=phases, texts=texts)
    if vehicle := rows.get("vehicle"):
        flight.vehicle_t_s = np.array([t for t, _ in vehicle])
        flight.vehicle_pos_ned_m = np.array([m["pos_ned_m"] for _, m in vehicle], dtype=np.float64)
        flight.vehicle_vel_ned_m_s = np.array([m["vel_ned_m_s"] for _, m in vehicle], dtype=np.float64)
    if detections := rows.get("detections"):
        flight.detection_t_s = np.array([t for t, _ in detections])
        flight.detected = np.array([float(bool(m["contours"])) for _, m in detections])
        flight.detection_ms = np.array([1e3 * m["elapsed_s"] for _, m in detections])
    if fixes := rows.get("fixes"):
        flight.fix_t_s = np.array([t for t, _ in fixes])
        relative = np.array([m["pad_from_vehicle_ned_m"] for _, m in fixes], dtype=np.float64)
        flight.fix_height_m = relative[:, 2]
        flight.fix_horizontal_m = np.hypot(relative[:, 0], relative[:, 1])
    if turns := rows.get("turns"):
        flight.turn_t_s = np.array([t for t, _ in turns])
        flight.turn_period_s = np.array([m["period_s"] for _, m in turns])
        touching = [bool(m["status"] and m["status"]["contact"]) for _, m in turns]
        begun = [t for (t, _), now, before in zip(turns, touching, [False, *touching], strict=False) if now > before]
        flight.contact_s = begun[-1] if begun else None
        flight.turn_sent = np.array([float(m["setpoint"] is not None) for _, m in turns])
        latencies = [m["fix_latency_s"] for _, m in turns if m["fix_latency_s"] is not None]
        flight.latency_s = np.array(latencies)
    return flight
