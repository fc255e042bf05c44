"""Jumps of PX4's local frame, told from motion: its estimator moves its origin or its heading in one step now and then.

LOCAL_POSITION_NED carries no reset counter, so a jump is what neither the velocity nor the turn rate explains.
"""

from __future__ import annotations

import math

import numpy as np

from app.frames import Array

POSITION_JUMP_M = 0.3
"""A smaller step is the estimator's ordinary correction (GNSS pulls it by centimetres a sample)."""
YAW_JUMP_RAD = math.radians(8.0)


class FrameResets:
    """Counts jumps in a stream of positions and one of attitudes, each with its own time.

    Attributes:
        count: Jumps so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._position: tuple[float, Array, Array] | None = None
        self._attitude: tuple[float, Array, Array] | None = None

    def forget(self) -> None:
        """The autopilot was restarted: what comes next is not compared with what came before, and is one jump."""
        self.count += 1
        self._position = self._attitude = None

    def see_position(self, t_s: float, pos_ned_m: Array, vel_ned_m_s: Array) -> bool:
        """Take a position (3,) with its velocity (3,) and time in seconds. Returns whether it jumped."""
        before, self._position = self._position, (t_s, pos_ned_m, vel_ned_m_s)
        if before is None or t_s <= before[0]:
            return False
        dt_s = t_s - before[0]
        expected = before[1] + 0.5 * (before[2] + vel_ned_m_s) * dt_s
        # Beside the step: 0.5 m/s by which the position may run against the velocity, and 16 m/s2 of a change of
        # acceleration inside the gap (a jump of a from 0 in the middle of it leaves a dt^2 / 8).
        limit_m = POSITION_JUMP_M + 0.5 * dt_s + 2.0 * dt_s * dt_s
        jumped = bool(np.linalg.norm(pos_ned_m - expected) > limit_m)
        self.count += jumped
        return jumped

    def see_attitude(self, t_s: float, q_wxyz: Array, rates_body_rad_s: Array) -> bool:
        """Take an attitude (4,) with its body rates (3,) and time in seconds. Returns whether it jumped."""
        before, self._attitude = self._attitude, (t_s, q_wxyz, rates_body_rad_s)
        if before is None or t_s <= before[0]:
            return False
        dt_s = t_s - before[0]
        expected = _turned(before[1], 0.5 * (before[2] + rates_body_rad_s) * dt_s)
        angle_rad = 2.0 * math.acos(min(1.0, abs(float(expected @ q_wxyz))))
        jumped = angle_rad > YAW_JUMP_RAD + 0.5 * dt_s + 10.0 * dt_s * dt_s
        self.count += jumped
        return jumped


def _turned(q_wxyz: Array, rotation_body_rad: Array) -> Array:
    """A unit quaternion (4,) turned on by a rotation vector (3,) in its own body axes."""
    angle = float(np.linalg.norm(rotation_body_rad))
    if angle < 1e-12:
        return q_wxyz
    x, y, z = (float(v) * math.sin(0.5 * angle) / angle for v in rotation_body_rad)
    w = math.cos(0.5 * angle)
    a, b, c, d = (float(v) for v in q_wxyz)
    return np.array(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]
    )
