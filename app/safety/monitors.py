"""Monitors: what the vehicle, the camera and the links say becomes at most one verdict, the gravest. Pure.

A verdict says what must happen; the mission state machine does it. Nothing here depends on the mission's phase but
what is said so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.config import SafetyConfig
from app.frames import Array, rotation_from_quaternion
from app.messages import Hazard, VehicleState, Verdict


def judge(
    vehicle: VehicleState | None,
    home_ned_m: Array | None,
    last_frame_s: float | None,
    now_s: float,
    config: SafetyConfig,
) -> Verdict | None:
    """The gravest hazard, or None.

    Args:
        vehicle: Newest state.
        home_ned_m: (3,) where this flight began, on the ground; None before it has.
        last_frame_s: Capture time of the newest frame; None before the first.
        now_s: The time.
        config: [safety].
    """
    if vehicle is None or not vehicle.connected:
        return Verdict(Hazard.LINK_LOST, "no heartbeat from the autopilot")
    age_s = now_s - vehicle.t_capture_s
    if age_s > config.vehicle_state_stale_s:
        return Verdict(Hazard.VEHICLE_STATE_STALE, f"attitude {age_s:.1f} s old")
    if not vehicle.local_position_ok or not np.isfinite([*vehicle.pos_ned_m, *vehicle.vel_ned_m_s]).all():
        return Verdict(Hazard.POSITION_LOST, "PX4 has no local position")
    cos_tilt = float(rotation_from_quaternion(vehicle.q_ned_from_body_wxyz)[2, 2])
    tilt_deg = math.degrees(math.acos(max(-1.0, min(1.0, cos_tilt))))
    if tilt_deg > config.tilt_max_deg:
        return Verdict(Hazard.TILT_EXCESSIVE, f"tilt {tilt_deg:.0f} over {config.tilt_max_deg:.0f} deg")
    battery = vehicle.battery_fraction
    if battery is not None and battery < config.battery_min_fraction:
        return Verdict(Hazard.BATTERY_LOW, f"battery {battery:.0%} under {config.battery_min_fraction:.0%}")
    if home_ned_m is not None:
        away = vehicle.pos_ned_m - home_ned_m
        distance_m, height_m = math.hypot(away[0], away[1]), -float(away[2])
        if distance_m > config.distance_from_home_max_m:
            return Verdict(Hazard.TOO_FAR, f"{distance_m:.0f} m away, over {config.distance_from_home_max_m:.0f}")
        if height_m > config.height_max_m:
            return Verdict(Hazard.TOO_HIGH, f"{height_m:.0f} m high, over {config.height_max_m:.0f}")
    if last_frame_s is None or now_s - last_frame_s > config.frames_stale_s:
        return Verdict(Hazard.FRAMES_STALE, "no camera frames")
    return None


CONFIRM_S: dict[Hazard, float] = {
    Hazard.POSITION_LOST: 0.3,
    Hazard.TILT_EXCESSIVE: 0.3,
    Hazard.BATTERY_LOW: 2.0,
    Hazard.TOO_FAR: 0.3,
    Hazard.TOO_HIGH: 0.3,
}
"""A hazard must stand this long: PX4's position flag was seen to drop for a single report, a battery sags under a
punch of thrust, a gust tilts. What is measured by an age already has its time in it."""


@dataclass(frozen=True, slots=True)
class Vigil:
    """The memory of `confirm`.

    Attributes:
        hazard: The gravest one at the last step; None without one.
        since_s: Since when without a break.
    """

    hazard: Hazard | None = None
    since_s: float = 0.0


def confirm(vigil: Vigil, verdict: Verdict | None, now_s: float) -> tuple[Vigil, Verdict | None]:
    """The next memory, and the verdict if its hazard has stood for long enough."""
    if verdict is None:
        return Vigil(), None
    since_s = vigil.since_s if vigil.hazard is verdict.hazard else now_s
    stands = now_s - since_s >= CONFIRM_S.get(verdict.hazard, 0.0)
    return Vigil(verdict.hazard, since_s), verdict if stands else None
