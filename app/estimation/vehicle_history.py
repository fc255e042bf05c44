"""The vehicle's recent poses, so that a frame is paired with the pose at its own mid-exposure. Pure."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import replace

from app.frames import slerp
from app.messages import VehicleState

EXTRAPOLATION_MAX_S = 0.10
"""Beyond the newest state the position is carried on by its velocity for this long (attitude is held): a frame may be
handled a few milliseconds before the telemetry of its own instant arrives. At 60 degrees a second, 0.1 s is 6 degrees
of attitude, the most that a fix may be wrong by before it is better not made."""


class VehicleHistory:
    """A time-ordered window of VehicleState.

    Args:
        length_s: States older than this before the newest are dropped.
    """

    def __init__(self, length_s: float) -> None:
        self._length_s = length_s
        self._states: deque[VehicleState] = deque()

    def add(self, state: VehicleState) -> None:
        """Add a state. One that is not newer than the last is ignored; a reset of PX4's local frame empties the past,
        since positions on both sides of it are in different frames.
        """
        if self._states and state.frame_resets != self._states[-1].frame_resets:
            self._states.clear()
        if self._states and state.t_capture_s <= self._states[-1].t_capture_s:
            return
        self._states.append(state)
        while state.t_capture_s - self._states[0].t_capture_s > self._length_s:
            self._states.popleft()

    def at(self, t_s: float) -> VehicleState | None:
        """The state at a time: interpolated, or carried on by at most EXTRAPOLATION_MAX_S; None if out of reach."""
        if not self._states or t_s < self._states[0].t_capture_s:
            return None
        newest = self._states[-1]
        if t_s >= newest.t_capture_s:
            ahead_s = t_s - newest.t_capture_s
            if ahead_s > EXTRAPOLATION_MAX_S:
                return None
            return replace(newest, t_capture_s=t_s, pos_ned_m=newest.pos_ned_m + ahead_s * newest.vel_ned_m_s)
        k = bisect_left(self._states, t_s, key=lambda state: state.t_capture_s)
        if k == 0:
            return self._states[0]
        before, after = self._states[k - 1], self._states[k]
        part = (t_s - before.t_capture_s) / (after.t_capture_s - before.t_capture_s)
        return replace(
            after,
            t_capture_s=t_s,
            pos_ned_m=(1 - part) * before.pos_ned_m + part * after.pos_ned_m,
            vel_ned_m_s=(1 - part) * before.vel_ned_m_s + part * after.vel_ned_m_s,
            q_ned_from_body_wxyz=slerp(before.q_ned_from_body_wxyz, after.q_ned_from_body_wxyz, part),
        )
