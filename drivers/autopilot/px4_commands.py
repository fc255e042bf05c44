"""What each AutopilotAction is as a MAVLink command, and a Setpoint as a MAVLink message. Pure."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from app.messages import AutopilotAction, FlightMode, LandingTarget, Setpoint
from drivers.autopilot.px4_modes import MAIN_SUB

Fields = dict[str, Any]

COMPONENT_ARM_DISARM, DO_SET_MODE, NAV_TAKEOFF, SET_MESSAGE_INTERVAL = 400, 176, 22, 511
FORCE = 21196.0
"""Parameter 2 of COMPONENT_ARM_DISARM: disarm in the air too."""

# POSITION_TARGET_TYPEMASK: position (7), acceleration (448), yaw rate (2048) ignored.
VELOCITY_YAW, VELOCITY_ACCELERATION_YAW = 2503, 2055
_MODE = {
    AutopilotAction.OFFBOARD: FlightMode.OFFBOARD,
    AutopilotAction.HOLD: FlightMode.HOLD,
    AutopilotAction.LAND: FlightMode.LAND,
    AutopilotAction.PRECLAND: FlightMode.PRECLAND,
    AutopilotAction.RETURN: FlightMode.RETURN,
}


def command_long(system_id: int, command: int, *params: float) -> Fields:
    """Fields of a COMMAND_LONG to the autopilot of a system; parameters left out are 0."""
    padded = (*params, *(0.0,) * (7 - len(params)))
    named = {f"param{i}": value for i, value in enumerate(padded, start=1)}
    return {"target_system": system_id, "target_component": 1, "command": command, "confirmation": 0, **named}


def command_of(action: AutopilotAction, system_id: int, takeoff_amsl_m: float) -> Fields:
    """Fields of the COMMAND_LONG that an action is; takeoff_amsl_m is where a TAKEOFF ends.

    PX4 reads parameter 7 of NAV_TAKEOFF as metres above mean sea level and NaN in 4 to 6 as "as it is, here".
    """
    if action in _MODE:
        main, sub = MAIN_SUB[_MODE[action]]
        return command_long(system_id, DO_SET_MODE, 1.0, float(main), float(sub))
    match action:
        case AutopilotAction.ARM:
            return command_long(system_id, COMPONENT_ARM_DISARM, 1.0)
        case AutopilotAction.DISARM:
            return command_long(system_id, COMPONENT_ARM_DISARM, 0.0)
        case AutopilotAction.FORCE_DISARM:
            return command_long(system_id, COMPONENT_ARM_DISARM, 0.0, FORCE)
        case _:
            nan = math.nan
            return command_long(system_id, NAV_TAKEOFF, 0.0, 0.0, 0.0, nan, nan, nan, takeoff_amsl_m)


def setpoint_fields(setpoint: Setpoint, system_id: int, boot_s: float) -> Fields:
    """Fields of SET_POSITION_TARGET_LOCAL_NED: velocity and yaw, and the acceleration where one is given.

    Raises:
        ValueError: A value is not finite: PX4 would take it for "any".
    """
    vel = [float(v) for v in setpoint.vel_ned_m_s]
    acc = [float(v) for v in setpoint.acc_ned_m_s2]
    yaw = float(setpoint.yaw_ned_rad)
    if not np.isfinite([*vel, *acc, yaw]).all():
        raise ValueError(f"a setpoint that is not finite: {setpoint!r}")
    return {
        "time_boot_ms": int(boot_s * 1000.0) & 0xFFFF_FFFF,
        "target_system": system_id,
        "target_component": 1,
        "coordinate_frame": 1,  # MAV_FRAME_LOCAL_NED
        "type_mask": VELOCITY_ACCELERATION_YAW if any(acc) else VELOCITY_YAW,
        "vx": vel[0],
        "vy": vel[1],
        "vz": vel[2],
        "afx": acc[0],
        "afy": acc[1],
        "afz": acc[2],
        "yaw": yaw,
        "yaw_rate": 0.0,
    }


def landing_target_fields(target: LandingTarget, epoch_s: float) -> Fields:
    """Fields of LANDING_TARGET: the pad's place in PX4's local frame, as PX4's precision landing takes it.

    Args:
        target: What to tell.
        epoch_s: Its time since 1970. MAVSDK answers PX4's TIMESYNC by that clock, and PX4 converts it to its own; one
            that is not in step with us takes the time of arrival.

    Raises:
        ValueError: A value is not finite.
    """
    pos = [float(v) for v in target.pos_ned_m]
    half = 0.5 * float(target.yaw_ned_rad)
    if not np.isfinite([*pos, half]).all():
        raise ValueError(f"a landing target that is not finite: {target!r}")
    return {
        "time_usec": int(epoch_s * 1e6),
        "target_num": 0,
        "frame": 1,  # MAV_FRAME_LOCAL_NED: PX4 takes no other
        "angle_x": 0.0,
        "angle_y": 0.0,
        "distance": 0.0,
        "size_x": 0.0,
        "size_y": 0.0,
        "x": pos[0],
        "y": pos[1],
        "z": pos[2],
        "q": [math.cos(half), 0.0, 0.0, math.sin(half)],
        "type": 2,  # LANDING_TARGET_TYPE_VISION_FIDUCIAL
        "position_valid": 1,
    }
