"""Which track guidance goes by, in PX4's present local frame. Pure.

A track stands in the local frame of its last fix. When PX4 resets that frame, a track from before it is carried over
by the jump, so that a landing that is already committed is not steered by it; and a committed landing goes on with the
last usable track when no newer one comes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.frames import Array
from app.messages import PadTrack, VehicleState


class PadMemory:
    """Remembers the last usable track, and the last jump of PX4's local frame."""

    def __init__(self) -> None:
        self._vehicle: VehicleState | None = None
        self._last: PadTrack | None = None
        self._jump_ned_m = np.zeros(3)
        self._jumped_s = -np.inf

    def forget(self) -> None:
        """Nothing is committed any more."""
        self._vehicle, self._last = None, None

    def see(self, vehicle: VehicleState) -> Array:
        """(3,) how far PX4's local frame jumped since the vehicle state before; zeros as a rule."""
        before, self._vehicle = self._vehicle, vehicle
        if before is None or vehicle.frame_resets == before.frame_resets:
            return np.zeros(3)
        dt_s = vehicle.t_capture_s - before.t_capture_s
        self._jump_ned_m = vehicle.pos_ned_m - (before.pos_ned_m + dt_s * before.vel_ned_m_s)
        self._jumped_s = vehicle.t_capture_s
        if self._last is not None:
            self._last = replace(self._last, pos_ned_m=self._last.pos_ned_m + self._jump_ned_m)
        return self._jump_ned_m

    def pad(self, track: PadTrack | None, now_s: float, stale_s: float, *, committed: bool) -> PadTrack | None:
        """The pad at `now_s`: by the newest track if its last fix is at most `stale_s` old, or by the last one that was
        if a landing is committed; else None.
        """
        if track is not None and now_s - track.t_last_fix_s <= stale_s:
            if track.t_last_fix_s < self._jumped_s:
                track = replace(track, pos_ned_m=track.pos_ned_m + self._jump_ned_m)
            self._last = track
            return track.at(now_s)
        return self._last.at(now_s) if committed and self._last is not None else None


def is_finite(track: PadTrack) -> bool:
    """Whether every figure that guidance takes from a track is a number."""
    return bool(np.isfinite([*track.pos_ned_m, *track.vel_ned_m_s, track.yaw_ned_rad, track.yaw_rate_rad_s]).all())
