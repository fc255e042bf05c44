"""When a forced disarm is allowed. Pure.

PX4 refuses a plain disarm until its own land detector has spoken, which on a moving pad may never be. A forced disarm
is obeyed at once, in the air too, so it is asked for only when everything says that the vehicle stands on the pad.
"""

from __future__ import annotations

import math

from app.frames import is_rotation, rotation_from_quaternion, tilt_rad
from app.messages import GuidanceStatus, PadTrack, VehicleState

HEIGHT_MAX_M = 0.45
"""Body origin above the pad: legs of up to 30 cm and the drift of PX4's height during the blind last part."""
HEIGHT_MIN_M = -0.30
RELATIVE_SPEED_MAX_M_S = 0.8
TILT_MAX_RAD = math.radians(20.0)
MOVING_PAD_M_S = 0.5
HELD_MOVING_S = 0.6
"""On a moving pad: a quarter of a second beyond the 0.35 s that the contact monitor itself waits."""
WORD_AGE_MAX_S = 0.3
"""What the controller and the vehicle said longer ago proves nothing about now."""
HELD_STATIC_S = 7.0
"""On a pad at rest PX4's own detector needs 5 s after contact at 0.5 m/s of sink (measured); force only after that."""


def may_force_disarm(vehicle: VehicleState, track: PadTrack | None, guidance: GuidanceStatus, now_s: float) -> bool:
    """Whether every condition holds now: committed, in contact long enough, at the pad's height, slow and level."""
    if track is None or not (guidance.committed and guidance.contact):
        return False
    if not all(now_s - said_s <= WORD_AGE_MAX_S for said_s in (guidance.t_s, vehicle.t_capture_s)):
        return False
    if guidance.height_above_pad_m is None or guidance.relative_speed_m_s is None:
        return False
    if not HEIGHT_MIN_M <= guidance.height_above_pad_m <= HEIGHT_MAX_M:
        return False
    if not guidance.relative_speed_m_s <= RELATIVE_SPEED_MAX_M_S:  # so put, NaN forbids
        return False
    q = vehicle.q_ned_from_body_wxyz
    if not is_rotation(q) or not tilt_rad(rotation_from_quaternion(q)) <= TILT_MAX_RAD:
        return False
    moving = math.hypot(track.vel_ned_m_s[0], track.vel_ned_m_s[1]) > MOVING_PAD_M_S
    return guidance.contact_held_s >= (HELD_MOVING_S if moving else HELD_STATIC_S)
