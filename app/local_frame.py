"""Jumps of PX4's local frame, and how far what stands in the frame of a while ago has to be carried over. Pure.

PX4 resets its local position (GNSS that comes back, a height that is corrected), and counts how often. What was worked
out before such a jump is off by it afterwards. Two may come within a moment: a position's and a height's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.frames import Array
from app.messages import VehicleState

KEPT_S = 60.0
"""Nothing that is older than this is carried over: a committed landing takes 20 s at most."""


@dataclass(frozen=True, slots=True)
class FrameJumps:
    """The jumps of the last while.

    Attributes:
        vehicle: The newest state that was seen; None before the first.
        jumps: When each was seen, and (3,) how far everything jumped, m.
    """

    vehicle: VehicleState | None = None
    jumps: tuple[tuple[float, Array], ...] = ()

    def see(self, vehicle: VehicleState) -> FrameJumps:
        """The same with a newer state: where its frame is not that of the one before, what is more than it flew."""
        before, t_s = self.vehicle, vehicle.t_capture_s
        jumps = self.jumps
        if jumps and t_s - jumps[0][0] > KEPT_S:
            jumps = tuple(jump for jump in jumps if t_s - jump[0] <= KEPT_S)
        if before is not None and vehicle.frame_resets != before.frame_resets:
            flown = (t_s - before.t_capture_s) * before.vel_ned_m_s
            jumps = (*jumps, (t_s, vehicle.pos_ned_m - before.pos_ned_m - flown))
        return FrameJumps(vehicle, jumps)

    def since(self, t_s: float) -> Array:
        """(3,) what to add to a place in the frame of that time to have it in the present one."""
        return sum((jump for at_s, jump in self.jumps if at_s > t_s), np.zeros(3))
