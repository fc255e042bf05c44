"""PX4's own precision landing, fed: the track becomes the target that PX4 is told, and a word for the mission. Pure.

PX4 flies (its mode PRECLAND): over the target within 0.2 m (PLD_HACC_RAD) it sinks, following the target, and finishes
by itself once it is within 0.1 m of it (PLD_FAPPR_ALT) or hears no more of it.
"""

from __future__ import annotations

import math

import numpy as np

from app.config import GuidanceConfig, SafetyConfig
from app.guidance.pad_memory import PadMemory, is_finite
from app.messages import FlightMode, Goal, GuidanceStatus, LandedState, LandingTarget, PadTrack, VehicleState

COMMIT_ERROR_M = 0.4
"""Twice PX4's own radius: farther off below the commit height, it is about to come down beside the pad."""
RELEASE_FACTOR = 2.0
"""So many commit heights up again the landing has been broken off."""


class PrecisionLanding:
    """Remembers whether PX4 has taken the landing over, and whether it is to be finished.

    Args:
        guidance: [guidance]; only the commit height.
        safety: [safety]; only the age at which a track is stale.

    Attributes:
        taken_over: PX4 was seen in its mode PRECLAND: nothing else is to steer in this landing any more.
    """

    taken_over: bool

    def __init__(self, guidance: GuidanceConfig, safety: SafetyConfig) -> None:
        self._guidance = guidance
        self._safety = safety
        self._pads = PadMemory()
        self.forget()

    def forget(self) -> None:
        """The landing has ended: nothing of it may reach into the next one."""
        self._goal_number = -1
        self.taken_over = False
        self._committed = False
        self._contact_since_s: float | None = None
        self._pads.forget()

    def step(
        self, goal: Goal, track: PadTrack | None, vehicle: VehicleState, now_s: float
    ) -> tuple[LandingTarget | None, GuidanceStatus]:
        """One turn.

        Args:
            goal: PRECLAND; another number begins another landing.
            track: The target estimator's newest state, or None.
            vehicle: The newest vehicle state; the caller has checked that it is fresh.
            now_s: The time.

        Returns:
            What to tell PX4, or None (the track is stale and no landing is committed: PX4's own time limit runs), and
            what the mission needs to know.
        """
        if goal.number != self._goal_number:
            self.forget()
            self._goal_number = goal.number
        self.taken_over = self.taken_over or vehicle.mode is FlightMode.PRECLAND
        self._pads.see(vehicle)
        track = track if track is not None and is_finite(track) else None
        pad = self._pads.pad(track, now_s, self._safety.track_stale_s, committed=self._committed)
        landed = vehicle.landed is LandedState.ON_GROUND
        self._contact_since_s = (self._contact_since_s or now_s) if landed and self._committed else None
        held_s = 0.0 if self._contact_since_s is None else now_s - self._contact_since_s
        if pad is None:
            return None, GuidanceStatus(now_s, goal.number)
        here = vehicle.pos_ned_m + (now_s - vehicle.t_capture_s) * vehicle.vel_ned_m_s
        # The pad is at rest: the speed that the track gives it is error, and out of sight nothing corrects it.
        unseen_s = max(0.0, now_s - pad.t_last_fix_s - self._safety.track_stale_s)
        pos_ned_m = pad.pos_ned_m - unseen_s * pad.vel_ned_m_s
        error_ned_m = pos_ned_m - here
        moving_ne_m_s = pad.vel_ned_m_s[:2] - vehicle.vel_ned_m_s[:2]
        error_m, height_m = math.hypot(error_ned_m[0], error_ned_m[1]), float(error_ned_m[2])
        if self._committed:
            self._committed = landed or height_m <= RELEASE_FACTOR * self._guidance.commit_height_m
        else:
            self._committed = height_m <= self._guidance.commit_height_m and error_m <= COMMIT_ERROR_M
        status = GuidanceStatus(
            t_s=now_s,
            goal_number=goal.number,
            horizontal_error_m=error_m,
            height_above_pad_m=height_m,
            relative_speed_m_s=math.hypot(moving_ne_m_s[0], moving_ne_m_s[1]),
            committed=self._committed,
            contact=self._contact_since_s is not None,
            contact_held_s=held_s,
        )
        return LandingTarget(now_s, np.array(pos_ned_m), pad.yaw_ned_rad), status
