"""The vehicle's recent poses, so that a frame is paired with the pose at its own mid-exposure. Pure."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from app.frames import Array, rotation_from_quaternion, slerp
from app.messages import VehicleState

EXTRAPOLATION_MAX_S = 0.10
"""Beyond the newest state the position is carried on by its velocity for this long (attitude is held): a frame may be
handled a few milliseconds before the telemetry of its own instant arrives. At 60 degrees a second, 0.1 s is 6 degrees
of attitude, the most that a fix may be wrong by before it is better not made."""

GAP_MAX_S = 0.25
"""Telemetry comes every 0.1 s at the slowest that can be configured; over a longer gap the attitude is a guess."""

TURNING_S = 0.04
"""The angular velocity is the attitude's change over this long: two of PX4's attitude messages."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The vehicle at one time.

    Attributes:
        state: Its state.
        travelled_ned_m: (3,) the integral of PX4's velocity since the history began; differences of it mean something,
            its value does not.
    """

    state: VehicleState
    travelled_ned_m: Array


class VehicleHistory:
    """A time-ordered window of moments.

    Args:
        length_s: What is older than this before the newest is dropped.
    """

    def __init__(self, length_s: float) -> None:
        self._length_s = length_s
        self._moments: deque[Moment] = deque()

    def add(self, state: VehicleState) -> None:
        """Add a state; one that is not newer than the last is ignored.

        A reset of PX4's local frame empties the past: positions on both sides of it are in different frames.
        """
        moments = self._moments
        if moments and state.frame_resets != moments[-1].state.frame_resets:
            moments.clear()
        if not moments:
            moments.append(Moment(state, np.zeros(3)))
            return
        last = moments[-1]
        dt_s = state.t_capture_s - last.state.t_capture_s
        if dt_s <= 0.0:
            return
        way = 0.5 * dt_s * (last.state.vel_ned_m_s + state.vel_ned_m_s)
        moments.append(Moment(state, last.travelled_ned_m + way))
        while state.t_capture_s - moments[0].state.t_capture_s > self._length_s:
            moments.popleft()

    def at(self, t_s: float) -> Moment | None:
        """The moment at a time: interpolated, or carried on by at most EXTRAPOLATION_MAX_S; None if out of reach
        or in a gap of more than GAP_MAX_S.
        """
        moments = self._moments
        if not moments or t_s < moments[0].state.t_capture_s:
            return None
        newest = moments[-1]
        if t_s >= newest.state.t_capture_s:
            ahead_s = t_s - newest.state.t_capture_s
            if ahead_s > EXTRAPOLATION_MAX_S:
                return None
            way = ahead_s * newest.state.vel_ned_m_s
            state = replace(newest.state, t_capture_s=t_s, pos_ned_m=newest.state.pos_ned_m + way)
            return Moment(state, newest.travelled_ned_m + way)
        k = bisect_left(moments, t_s, key=lambda moment: moment.state.t_capture_s)
        if k == 0:
            return moments[0]
        if moments[k].state.t_capture_s - moments[k - 1].state.t_capture_s > GAP_MAX_S:
            return None
        return _between(moments[k - 1], moments[k], t_s)

    def turning_rad_s(self, t_s: float) -> Array | None:
        """(3,) the vehicle's angular velocity along the ned axes, over TURNING_S about a time; None where that isn't
        known.
        """
        newest = self._moments[-1].state.t_capture_s if self._moments else t_s
        end = min(t_s + 0.5 * TURNING_S, newest)
        before, after = self.at(end - TURNING_S), self.at(end)
        if before is None or after is None:
            return None
        turn = (
            rotation_from_quaternion(after.state.q_ned_from_body_wxyz)
            @ rotation_from_quaternion(before.state.q_ned_from_body_wxyz).T
        )
        # The skew part of a small rotation is its rotation vector.
        vector = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        result: Array = vector / TURNING_S
        return result


def _between(before: Moment, after: Moment, t_s: float) -> Moment:
    a, b = before.state, after.state
    part = (t_s - a.t_capture_s) / (b.t_capture_s - a.t_capture_s)
    state = replace(
        b,
        t_capture_s=t_s,
        pos_ned_m=(1 - part) * a.pos_ned_m + part * b.pos_ned_m,
        vel_ned_m_s=(1 - part) * a.vel_ned_m_s + part * b.vel_ned_m_s,
        q_ned_from_body_wxyz=slerp(a.q_ned_from_body_wxyz, b.q_ned_from_body_wxyz, part),
    )
    return Moment(state, (1 - part) * before.travelled_ned_m + part * after.travelled_ned_m)
