"""Which track guidance goes by, in PX4's present local frame. Pure.

A track stands in the local frame of its last fix. When PX4 resets that frame, a track from before it is carried over
by the jump, so that a landing that is already committed is not steered by it; and a committed landing goes on with the
last usable track when no newer one comes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.frames import Array
from app.local_frame import FrameJumps
from app.messages import PadTrack, VehicleState


class PadMemory:
    """Remembers the last usable track, and the jumps of PX4's local frame."""

    def __init__(self) -> None:
        self._jumps = FrameJumps()
        self._last: PadTrack | None = None

    def forget(self) -> None:
        """Nothing is committed any more."""
        self._jumps, self._last = FrameJumps(), None

    def see(self, vehicle: VehicleState) -> Array:
        """(3,) how far PX4's local frame jumped since the vehicle state before; zeros as a rule."""
        before = self._jumps.vehicle
        self._jumps = self._jumps.see(vehicle)
        return np.zeros(3) if before is None else self._jumps.since(before.t_capture_s)

    def jumped_since(self, t_s: float) -> Array:
        """(3,) what to add to a place in the frame of that time to have it in the present one."""
        return self._jumps.since(t_s)

    def pad(self, track: PadTrack | None, now_s: float, stale_s: float, *, committed: bool) -> PadTrack | None:
        """The pad at `now_s`: by the newest track if its last fix is at most `stale_s` old, or by the last one that was
        if a landing is committed; else None.
        """
        if track is not None and now_s - track.t_last_fix_s <= stale_s:
            self._last = track
        elif not committed or self._last is None:
            return None
        last = self._last
        return replace(last, pos_ned_m=last.pos_ned_m + self._jumps.since(last.t_last_fix_s)).at(now_s)


def is_finite(track: PadTrack) -> bool:
    """Whether every figure that guidance can't do without in a track is a number. A lean that is none counts as the
    steepest there is (PadTrack.lean_rad): a landing that is committed has to know where the pad is all the same.
    """
    times_s = (track.t_capture_s, track.t_last_fix_s)
    turning = (track.yaw_ned_rad, track.yaw_rate_rad_s, track.turn_rate_rad_s)
    return bool(np.isfinite([*times_s, *track.pos_ned_m, *track.vel_ned_m_s, *turning]).all())
