"""One flight as arrays: what the record holds, and, where a simulator flew, what it says was true. Pure."""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

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
        for start, end, phase in self.spans_s():
            if phase != "idle":
                total[phase] = total.get(phase, 0.0) + end - start
        return total

    def spans_s(self) -> list[tuple[float, float, str]]:
        """(begin, end, phase) in order, the last to the end of the record."""
        begins = [t for t, _, _ in self.phases]
        ends = [*begins[1:], max([self.end_s, *begins[-1:]])]
        return [(begin, end, phase) for begin, end, (_, phase, _) in zip(begins, ends, self.phases, strict=False)]

    def window_s(self) -> tuple[float, float]:
        """From the first phase that is not idle to the end of the flying."""
        active = [t for t, phase, _ in self.phases if phase != "idle"]
        ended = [t for t, phase, _ in self.phases if phase in ("landed", "idle") and active and t > active[0]]
        start = active[0] if active else 0.0
        return start, (ended[0] if ended else self.end_s)


def collect_flight(items: Iterable[Recorded]) -> Flight:
    """Gather a record's items into arrays; images and unknown topics are left out."""
    rows: defaultdict[str, array[float]] = defaultdict(lambda: array("d"))
    flight = Flight()
    phases, touched = flight.phases, False
    for topic, t_s, _, message in items:
        if isinstance(message, Frame):
            continue
        match topic:
            case "reports":
                if not phases or phases[-1][1] != message["phase"] or phases[-1][2] != message["reason"]:
                    phases.append((t_s, message["phase"], message["reason"]))
            case "texts":
                flight.texts.append((t_s, message["text"]))
            case "vehicle":
                rows[topic].extend(map(_number, (t_s, *message["pos_ned_m"], *message["vel_ned_m_s"])))
            case "detections":
                rows[topic].extend((t_s, bool(message["contours"]), 1e3 * _number(message["elapsed_s"])))
            case "fixes":
                rows[topic].extend(map(_number, (t_s, *message["pad_from_vehicle_ned_m"])))
            case "turns":
                rows[topic].extend((t_s, _number(message["period_s"]), message["setpoint"] is not None))
                touches = message["status"] is not None and message["status"]["contact"]
                if touches and not touched:
                    flight.contact_s = t_s
                touched = touches
                if message["fix_latency_s"] is not None:
                    rows["latencies"].append(message["fix_latency_s"])
            case _:
                pass

    def table(name: str, columns: int) -> Array:
        return np.array(rows[name], dtype=np.float64).reshape(-1, columns)

    vehicle, fixes = table("vehicle", 7), table("fixes", 4)
    flight.vehicle_t_s, flight.vehicle_pos_ned_m, flight.vehicle_vel_ned_m_s = (
        vehicle[:, 0],
        vehicle[:, 1:4],
        vehicle[:, 4:],
    )
    flight.detection_t_s, flight.detected, flight.detection_ms = table("detections", 3).T
    flight.fix_t_s, flight.fix_height_m = fixes[:, 0], fixes[:, 3]
    flight.fix_horizontal_m = np.hypot(fixes[:, 1], fixes[:, 2])
    flight.turn_t_s, flight.turn_period_s, flight.turn_sent = table("turns", 3).T
    flight.latency_s = table("latencies", 1)[:, 0]
    return flight


def _number(value: float | None) -> float:
    """NaN is null in a record."""
    return np.nan if value is None else value
