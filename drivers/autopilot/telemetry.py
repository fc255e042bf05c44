"""PX4's messages put together to one VehicleState a time the attitude comes. Pure: fields and arrival times in.

The attitude and the position come in messages of their own, each with its own time since boot. A state is valid at
the attitude's time: the position is carried there with its velocity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from app.frames import Array
from app.messages import FlightMode, LandedState, VehicleState
from drivers.autopilot.boot_clock import BootClock
from drivers.autopilot.frame_resets import FrameResets
from drivers.autopilot.px4_modes import mode_from_custom

POSITION_MATCH_S = 0.3
"""A position further than this from the attitude's time is not carried to it: local_position_ok is then False."""
CURRENT_MODE_FRESH_S = 0.5
"""CURRENT_MODE, asked for at 10 Hz, outranks HEARTBEAT, which shows a failsafe's mode up to a second late."""
STEP_BACK_S = 0.5
"""A faster message than all before it moves the clock's offset back, and times with it: the states of that step are
left out, so that a reader sees time rise. Beyond this it is no such step but a new truth."""

_ARMED = 0x80  # MAV_MODE_FLAG_SAFETY_ARMED
_PREARM_CHECK = 0x1000_0000  # MAV_SYS_STATUS_PREARM_CHECK
# ESTIMATOR_ATTITUDE, _VELOCITY_HORIZ, _VELOCITY_VERT, _POS_VERT_ABS: all; _POS_HORIZ_REL, _POS_HORIZ_ABS: either.
_ESTIMATOR_ALL, _ESTIMATOR_EITHER = 0x27, 0x18
_LANDED = {
    1: LandedState.ON_GROUND,
    2: LandedState.IN_AIR,
    3: LandedState.TAKING_OFF,
    4: LandedState.LANDING,
}

NAMES = (
    "HEARTBEAT",
    "ATTITUDE_QUATERNION",
    "LOCAL_POSITION_NED",
    "EXTENDED_SYS_STATE",
    "CURRENT_MODE",
    "SYS_STATUS",
    "ESTIMATOR_STATUS",
    "GLOBAL_POSITION_INT",
)
"""The messages that are read."""


def _vector(fields: Mapping[str, Any], *keys: str) -> Array | None:
    """Fields as an array, or None if one is missing or not finite (null in MAVSDK's JSON)."""
    values = [fields.get(key) for key in keys]
    if any(value is None or not math.isfinite(value) for value in values):
        return None
    return np.array(values, dtype=np.float64)


class VehicleTelemetry:
    """What PX4 has said so far.

    Attributes:
        clock: PX4's boot clock on ours.
        last_heard_s: Arrival of the newest HEARTBEAT or attitude, on our clock; -inf before the first.
        altitude_amsl_m: Height above mean sea level with its arrival time, or None.
    """

    def __init__(self) -> None:
        self.clock = BootClock()
        self.last_heard_s = -math.inf
        self.altitude_amsl_m: tuple[float, float] | None = None
        self._resets = FrameResets()
        self._position: tuple[float, Array, Array] | None = None
        self._estimator_ok = False
        self._mode_s = -math.inf
        self._state = VehicleState(
            t_capture_s=0.0,
            pos_ned_m=np.zeros(3),
            vel_ned_m_s=np.zeros(3),
            q_ned_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
            connected=False,
        )
        self._seen_attitude = False

    def take(self, name: str, fields: Mapping[str, Any], arrival_s: float) -> VehicleState | None:
        """Take a message from the autopilot.

        Args:
            name: One of NAMES; another is ignored.
            fields: By their MAVLink names, in MAVLink's units; NaN as None.
            arrival_s: On our clock.

        Returns:
            The state at the attitude's time if the message is an attitude, else None.
        """
        match name:
            case "ATTITUDE_QUATERNION":
                return self._take_attitude(fields, arrival_s)
            case "LOCAL_POSITION_NED":
                self._take_position(fields, arrival_s)
            case "HEARTBEAT":
                self.last_heard_s = arrival_s
                self._state = replace(self._state, armed=bool(int(fields["base_mode"]) & _ARMED))
                if arrival_s - self._mode_s > CURRENT_MODE_FRESH_S:
                    self._state = replace(self._state, mode=mode_from_custom(int(fields["custom_mode"])))
            case "CURRENT_MODE":
                mode = mode_from_custom(int(fields["custom_mode"]))
                if mode is not FlightMode.UNKNOWN:
                    self._mode_s = arrival_s
                    self._state = replace(self._state, mode=mode)
            case "EXTENDED_SYS_STATE":
                landed = _LANDED.get(int(fields["landed_state"]), LandedState.UNKNOWN)
                self._state = replace(self._state, landed=landed)
            case "SYS_STATUS":
                remaining = int(fields["battery_remaining"])
                self._state = replace(
                    self._state,
                    armable=bool(int(fields["onboard_control_sensors_health"]) & _PREARM_CHECK),
                    battery_fraction=remaining / 100.0 if remaining >= 0 else None,
                )
            case "ESTIMATOR_STATUS":
                flags = int(fields["flags"])
                self._estimator_ok = (flags & _ESTIMATOR_ALL) == _ESTIMATOR_ALL and bool(flags & _ESTIMATOR_EITHER)
            case "GLOBAL_POSITION_INT":
                self.altitude_amsl_m = (int(fields["alt"]) / 1000.0, arrival_s)
            case _:
                pass
        return None

    def note_armed(self, armed: bool) -> None:
        """PX4 accepted to arm or disarm: known at once, not with the next HEARTBEAT."""
        self._state = replace(self._state, armed=armed)

    def without_attitude(self, *, connected: bool) -> VehicleState | None:
        """The newest state again, its time unchanged, when no attitude comes; None before the first attitude."""
        return replace(self._state, connected=connected) if self._seen_attitude else None

    def _observe(self, boot_s: float, arrival_s: float) -> None:
        if self.clock.observe(boot_s, arrival_s):
            self._resets.forget()
            self._position = None

    def _take_position(self, fields: Mapping[str, Any], arrival_s: float) -> None:
        pos, vel = _vector(fields, "x", "y", "z"), _vector(fields, "vx", "vy", "vz")
        boot_s = int(fields["time_boot_ms"]) / 1000.0
        self._observe(boot_s, arrival_s)
        if pos is None or vel is None:
            self._position = None
            return
        self._resets.see_position(boot_s, pos, vel)
        self._position = (boot_s, pos, vel)

    def _take_attitude(self, fields: Mapping[str, Any], arrival_s: float) -> VehicleState | None:
        self.last_heard_s = arrival_s
        boot_s = int(fields["time_boot_ms"]) / 1000.0
        self._observe(boot_s, arrival_s)
        q = _vector(fields, "q1", "q2", "q3", "q4")
        rates = _vector(fields, "rollspeed", "pitchspeed", "yawspeed")
        if q is None or float(q @ q) < 0.5:
            return None
        q = q / math.sqrt(float(q @ q))
        if rates is not None:
            self._resets.see_attitude(boot_s, q, rates)
        pos, vel, matched = self._state.pos_ned_m, self._state.vel_ned_m_s, False
        if self._position is not None:
            dt_s = boot_s - self._position[0]
            matched = abs(dt_s) <= POSITION_MATCH_S
            if matched:
                vel = self._position[2]
                pos = self._position[1] + vel * dt_s
        t_capture_s = self.clock.to_ours_s(boot_s)
        step_back_s = self._state.t_capture_s - t_capture_s
        if self._seen_attitude and 0.0 <= step_back_s < STEP_BACK_S:
            return None
        self._seen_attitude = True
        self._state = replace(
            self._state,
            t_capture_s=t_capture_s,
            pos_ned_m=pos,
            vel_ned_m_s=vel,
            q_ned_from_body_wxyz=q,
            connected=True,
            local_position_ok=matched and self._estimator_ok,
            frame_resets=self._resets.count,
        )
        return self._state
