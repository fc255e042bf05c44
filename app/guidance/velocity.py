"""The velocity controller: a goal, the track and the vehicle become one velocity setpoint. Pure but for its memory.

Velocity = the pad's velocity + a position law limited in speed, led by limits of acceleration and jerk. The rate of
that velocity goes along as acceleration feed-forward, which takes out the lag of PX4's velocity loop (measured: 0.2 s
dead time, 63% after 0.7 s), and so does what holds against gusts (gusts.py). The pad is predicted to the instant at
which the command takes effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from app.config import GuidanceConfig, SafetyConfig
from app.frames import Array, clamp, rotation_from_quaternion, tilt_rad, wrap_angle_rad, yaw_from_rotation
from app.guidance.descent import Descent, feel_deck, predicted_error_m, sink_speed_m_s, step_descent, touchdown_in_s
from app.guidance.gusts import Gusts, step_gusts
from app.guidance.limits import approach, closing_speed_m_s, limit_norm
from app.guidance.pad_memory import PadMemory, is_finite
from app.guidance.search import SearchPattern, expanding_square_m
from app.guidance.touchdown import Contact, step_contact
from app.messages import Goal, GoalKind, GuidanceStatus, PadTrack, Setpoint, VehicleState

OVER_THE_PAD = frozenset({GoalKind.HOVER, GoalKind.TRACK, GoalKind.LAND, GoalKind.PRECLAND})
HEIGHT_GAIN_1_S = 0.8
"""Vertical position law; PX4's vertical velocity loop is three times faster than its horizontal one."""
FEED_FORWARD_TAU_S = 0.20
"""The commanded velocity is differentiated through this low-pass: vision's noise must not shake the vehicle."""
HEIGHT_REACHED_M = 0.3
TRIM_REACH_M = 0.3
"""The trim learns only this near to the pad: farther off the speed limit, not a disturbance, makes the error."""
YAW_DEADBAND_RAD = math.radians(2.0)
PRESS_LEAN_MAX_RAD = math.radians(20.0)
FEET_M = 0.1
"""The vehicle's centre over its feet, about."""
GUST_CLEARANCE_M = 0.12
"""Feet nearer to the deck than this touch it in the time that gusts take to be found."""
REACH_MARGIN_M_S = 0.3
"""A pad must be slower than the vehicle's own limit by this, or what is missing is never made up."""
TOO_FAST_FOR_S = 1.0
GAP_MAX_S = 0.5
"""After a silence this long PX4 may have flown on its own: the next command starts from what the vehicle does then."""


@dataclass(frozen=True, slots=True)
class _Relative:
    """The pad relative to the vehicle, both predicted to one instant."""

    error_ne_m: Array
    height_m: float
    relative_ne_m_s: Array
    relative_sink_m_s: float
    pad: PadTrack


class VelocityController:
    """Remembers the last command and its rate (for the limits), the search's progress, the descent and the contact.

    Args:
        guidance: [guidance].
        safety: [safety]; only the age at which a track is stale.
    """

    def __init__(self, guidance: GuidanceConfig, safety: SafetyConfig) -> None:
        self._guidance = guidance
        self._safety = safety
        self._goal_number = -1
        self._search: SearchPattern | None = None
        self._descent = Descent()
        self._contact = Contact()
        self._velocity: Array | None = None
        self._rate = np.zeros(3)
        self._followed = False
        self._feed_forward = np.zeros(3)
        self._trim_ne_m_s = np.zeros(2)
        self._yaw_rad: float | None = None
        self._last_s = 0.0
        self._hold_height_down_m = 0.0
        self._anchor_ned_m = np.zeros(3)
        self._lean_rad = 0.0
        self._too_fast_since_s: float | None = None
        self._pads = PadMemory()
        self._gusts: Gusts | None = None

    def step(
        self, goal: Goal, track: PadTrack | None, vehicle: VehicleState, now_s: float
    ) -> tuple[Setpoint | None, GuidanceStatus]:
        """One turn of the control loop.

        Args:
            goal: What the mission wants.
            track: The target estimator's newest state, or None.
            vehicle: The newest vehicle state; the caller has checked that it is fresh.
            now_s: The time.

        Returns:
            The setpoint to send, or None (goal NONE: say nothing), and what the mission needs to know.
        """
        if goal.kind is GoalKind.NONE:
            self.forget()
            return None, GuidanceStatus(now_s, goal.number)
        track = track if track is not None and is_finite(track) else None
        self._follow_frame(vehicle)
        frame_s = vehicle.t_capture_s
        vehicle = replace(vehicle, pos_ned_m=vehicle.pos_ned_m + (now_s - vehicle.t_capture_s) * vehicle.vel_ned_m_s)
        if now_s - self._last_s > GAP_MAX_S:
            self._velocity, self._yaw_rad, self._contact = None, None, Contact()
        if goal.number != self._goal_number:
            self._begin(goal, vehicle)
        dt_s = min(max(now_s - self._last_s, 1e-3), 0.2) if self._velocity is not None else 0.02
        self._last_s = now_s
        if goal.kind in (GoalKind.SEARCH, GoalKind.CLIMB):
            self._anchor_ned_m[:2] += dt_s * np.array(goal.drift_ne_m_s)  # in place: the search pattern's too
        self._start_from(vehicle)
        self._lean_rad = tilt_rad(rotation_from_quaternion(vehicle.q_ned_from_body_wxyz))
        relative = self._relate(goal, track, vehicle, now_s)
        self._feel_gusts(relative, vehicle)
        self._learn_trim(goal, relative, dt_s)
        wanted = self._wanted(goal, relative, track, vehicle, now_s)
        setpoint = self._limit(wanted, relative, vehicle, dt_s, now_s)
        if not np.isfinite([*setpoint.vel_ned_m_s, *setpoint.acc_ned_m_s2, setpoint.yaw_ned_rad]).all():
            self.forget()  # one NaN would stay in it: PX4 hears nothing, and its own failsafe acts if this lasts
            return None, GuidanceStatus(now_s, goal.number)
        if goal.kind is GoalKind.LAND and relative is not None and self._descent.committed:
            # What presses the vehicle onto the pad is no measure of how it would fall beside it.
            sink = min(float(setpoint.vel_ned_m_s[2] - relative.pad.vel_ned_m_s[2]), self._guidance.touchdown_speed_m_s)
            self._contact = step_contact(self._contact, sink, relative.relative_sink_m_s, now_s)
            self._descent = feel_deck(self._descent, relative.height_m, contact=self._contact.contact)
        else:
            self._contact = Contact()
        return setpoint, replace(self._status(goal, relative, vehicle, now_s), frame_s=frame_s)

    # ------------------------------------------------------------------------------------------------ memory
    def forget(self) -> None:
        """Steering has ended: nothing of it may reach into the next flight."""
        self._goal_number, self._velocity, self._yaw_rad = -1, None, None
        self._search, self._descent, self._contact = None, Descent(), Contact()
        self._trim_ne_m_s = np.zeros(2)
        self._too_fast_since_s = None
        self._gusts = None
        self._pads.forget()

    def _begin(self, goal: Goal, vehicle: VehicleState) -> None:
        self._goal_number = goal.number
        self._descent, self._contact = Descent(), Contact()
        self._hold_height_down_m = float(vehicle.pos_ned_m[2])
        self._anchor_ned_m = np.array(goal.anchor_ned_m, dtype=np.float64)
        if goal.frame_s is not None:
            self._anchor_ned_m += self._pads.jumped_since(goal.frame_s)
        self._search = None
        if goal.kind is GoalKind.SEARCH:
            corners = expanding_square_m(self._guidance.search_spacing_m, self._guidance.search_radius_m)
            self._search = SearchPattern(self._anchor_ned_m, goal.pattern_scale * corners)

    def _follow_frame(self, vehicle: VehicleState) -> None:
        """Carry over what stands in PX4's local frame when that frame jumps."""
        jump = self._pads.see(vehicle)
        if np.any(jump):
            self._hold_height_down_m += float(jump[2])
            self._anchor_ned_m += jump  # in place: the search pattern's too
            self._yaw_rad = None
            self._gusts = None  # the velocity may have jumped along

    def _feel_gusts(self, relative: _Relative | None, vehicle: VehicleState) -> None:
        """On the deck it is the feet that hold against the thrust, and not the air: what was found before stays."""
        low = relative is not None and relative.height_m < FEET_M + GUST_CLEARANCE_M
        if self._descent.committed and (low or self._contact.stopped_since_s is not None):
            return
        velocity = vehicle.vel_ned_m_s[:2]
        self._gusts = step_gusts(self._gusts, vehicle.q_ned_from_body_wxyz, velocity, vehicle.t_capture_s)

    def _start_from(self, vehicle: VehicleState) -> None:
        if self._velocity is None:  # the command starts from what the vehicle does now
            self._velocity = np.array(vehicle.vel_ned_m_s, dtype=np.float64)
            self._rate, self._feed_forward = np.zeros(3), np.zeros(3)
        if self._yaw_rad is None:
            self._yaw_rad = yaw_from_rotation(rotation_from_quaternion(vehicle.q_ned_from_body_wxyz))

    # ------------------------------------------------------------------------------------------- the pad, now
    def _relate(self, goal: Goal, track: PadTrack | None, vehicle: VehicleState, now_s: float) -> _Relative | None:
        """The pad relative to the vehicle; None if there is no track, or it is stale and no landing is committed."""
        committed = goal.kind is GoalKind.LAND and self._descent.committed
        pad = self._pads.pad(track, now_s, self._safety.track_stale_s, committed=committed)
        if pad is None:
            return None
        error = pad.pos_ned_m - vehicle.pos_ned_m
        moving = pad.vel_ned_m_s - vehicle.vel_ned_m_s
        return _Relative(error[:2], float(error[2]), moving[:2], float(-moving[2]), pad)

    # ------------------------------------------------------------------------------------------------ the law
    def _wanted(
        self, goal: Goal, relative: _Relative | None, track: PadTrack | None, vehicle: VehicleState, now_s: float
    ) -> Array:
        """(3,) velocity before the limits of acceleration and jerk."""
        wanted = np.zeros(3)
        if goal.kind is GoalKind.SEARCH and self._search is not None:
            pattern = self._search.velocity_ne_m_s(
                vehicle.pos_ned_m, self._guidance.search_speed_m_s, self._guidance.acceleration_max_m_s2 / 2
            )
            wanted[:2] = limit_norm(pattern + goal.drift_ne_m_s, self._guidance.speed_max_m_s)
            wanted[2] = self._to_height(float(self._anchor_ned_m[2]) - goal.height_m, vehicle)
        elif goal.kind is GoalKind.CLIMB:
            drift = limit_norm(np.array(goal.drift_ne_m_s), self._guidance.speed_max_m_s)
            wanted[:2] = drift if drift.any() else self._coast(track, now_s)
            wanted[2] = clamp(self._to_height(float(self._anchor_ned_m[2]) - goal.height_m, vehicle), -math.inf, 0.0)
        elif goal.kind in OVER_THE_PAD:
            if relative is None:  # lost: hold the height; the mission decides what comes next
                if self._followed:  # an emergency: speeding up towards the pad ends at once, jerk or not
                    self._rate, self._followed = np.zeros(3), False
                wanted[:2] = self._coast(track, now_s)
                wanted[2] = self._to_height(self._hold_height_down_m, vehicle)
            else:
                self._hold_height_down_m = float(vehicle.pos_ned_m[2])
                self._followed = True
                wanted[:2] = self._follow(relative)
                wanted[2] = float(relative.pad.vel_ned_m_s[2]) + self._sink(goal, relative, now_s)
        return wanted

    def _coast(self, track: PadTrack | None, now_s: float) -> Array:
        """(2,) the pad's last known velocity for a short while, then zero: beside a pad that drives on, standing still
        is the surest way never to see it again. Nothing in it points at where the pad is believed to be.
        """
        if track is None or now_s - track.t_last_fix_s > self._guidance.coast_s:
            return np.zeros(2)
        return limit_norm(np.array(track.vel_ned_m_s[:2]), self._guidance.speed_max_m_s)

    def _to_height(self, down_m: float, vehicle: VehicleState) -> float:
        climb = self._guidance.climb_speed_m_s
        return clamp(HEIGHT_GAIN_1_S * (down_m - float(vehicle.pos_ned_m[2])), -climb, climb)

    def _follow(self, relative: _Relative) -> Array:
        """(2,) the pad's velocity, and a share that closes in; after contact nothing drags the vehicle sideways."""
        config = self._guidance
        pad_velocity = relative.pad.vel_ned_m_s[:2]
        if self._contact.contact:
            return np.array(pad_velocity)
        # Where the pad will be, relative to the vehicle, when this command takes effect.
        ahead = relative.error_ne_m + config.actuation_delay_s * relative.relative_ne_m_s
        distance = float(np.linalg.norm(ahead))
        speed = closing_speed_m_s(
            distance, config.position_gain_1_s, config.closing_speed_max_m_s, config.acceleration_max_m_s2 / 2
        )
        closing = ahead * (speed / distance) if distance > 1e-6 else np.zeros(2)
        return limit_norm(pad_velocity + closing + self._trim_ne_m_s, config.speed_max_m_s)

    def _learn_trim(self, goal: Goal, relative: _Relative | None, dt_s: float) -> None:
        """Integral action: PX4 holds the velocity that it believes in, which is off by 0.1 m/s for seconds (measured);
        over the pad the lasting error shows by how much. Forgotten with the pad, kept through a contact.
        """
        config = self._guidance
        if relative is None or goal.kind not in OVER_THE_PAD:
            self._trim_ne_m_s = np.zeros(2)
        elif not self._contact.contact and float(np.linalg.norm(relative.error_ne_m)) < TRIM_REACH_M:
            learnt = self._trim_ne_m_s + config.trim_gain_1_s2 * dt_s * relative.error_ne_m
            self._trim_ne_m_s = limit_norm(learnt, config.trim_max_m_s)

    def _presses(self, now_s: float) -> bool:
        """Whether to ask for more sink than the vehicle makes: half the thrust still carries one that stands, and a
        wind pushes it over the deck. One that leans far into the wind of a fast drive stands on two feet first: with
        less thrust it falls onto the others, and slides meanwhile.
        """
        return self._contact.contact or (self._contact.presses(now_s) and self._lean_rad < PRESS_LEAN_MAX_RAD)

    def _sink(self, goal: Goal, relative: _Relative, now_s: float) -> float:
        config = self._guidance
        if self._presses(now_s):
            return config.press_speed_m_s
        if goal.kind is GoalKind.LAND:
            self._descent = step_descent(
                self._descent,
                float(np.linalg.norm(relative.error_ne_m)),
                relative.height_m,
                float(np.linalg.norm(relative.relative_ne_m_s)),
                config,
                now_s,
                predicted_error_m(relative.error_ne_m, relative.relative_ne_m_s),
                relative.pad.lean_rad(
                    touchdown_in_s(relative.height_m - FEET_M, relative.relative_sink_m_s, config.touchdown_speed_m_s)
                ),
                now_s - relative.pad.t_last_fix_s,
            )
            return sink_speed_m_s(self._descent, relative.height_m, config)
        sink = HEIGHT_GAIN_1_S * (relative.height_m - goal.height_m)
        return clamp(sink, -config.climb_speed_m_s, config.descend_speed_m_s)

    # --------------------------------------------------------------------------------------------- the limits
    def _limit(
        self, wanted: Array, relative: _Relative | None, vehicle: VehicleState, dt_s: float, now_s: float
    ) -> Setpoint:
        config = self._guidance
        previous = self._velocity if self._velocity is not None else vehicle.vel_ned_m_s
        velocity, rate = np.empty(3), np.empty(3)
        for axes in (slice(0, 2), slice(2, 3)):
            velocity[axes], rate[axes] = approach(
                previous[axes],
                self._rate[axes],
                wanted[axes],
                config.acceleration_max_m_s2,
                config.jerk_max_m_s3,
                dt_s,
            )
        if self._presses(now_s):
            velocity[2], rate[2] = wanted[2], 0.0  # nothing moves any more that could be jerked
        self._rate = rate
        part = dt_s / (FEED_FORWARD_TAU_S + dt_s)
        self._feed_forward = self._feed_forward + part * (rate - self._feed_forward)
        self._velocity = velocity
        acceleration = np.array([*(self._feed_forward[:2] + self._against_gusts()), 0.0])
        return Setpoint(now_s, velocity, acceleration, self._turn(relative, dt_s))

    def _against_gusts(self) -> Array:
        """(2,) acceleration that holds against what gusts do; none in contact, where nothing is to drag sideways."""
        if self._gusts is None or self._contact.contact:
            return np.zeros(2)
        return limit_norm(-self._guidance.gust_share * self._gusts.gust_ne_m_s2, self._guidance.gust_max_m_s2)

    def _turn(self, relative: _Relative | None, dt_s: float) -> float:
        """The heading to hold, moved to the pad's at the limited rate."""
        yaw = self._yaw_rad if self._yaw_rad is not None else 0.0
        if self._guidance.align_yaw and relative is not None and not self._descent.committed:
            difference = wrap_angle_rad(relative.pad.yaw_ned_rad - yaw)
            if abs(difference) > YAW_DEADBAND_RAD:
                step = math.radians(self._guidance.yaw_rate_max_deg_s) * dt_s
                yaw = wrap_angle_rad(yaw + clamp(difference, -step, step))
        self._yaw_rad = yaw
        return yaw

    # --------------------------------------------------------------------------------------------- the report
    def _status(self, goal: Goal, relative: _Relative | None, vehicle: VehicleState, now_s: float) -> GuidanceStatus:
        climb_to = float(self._anchor_ned_m[2]) - goal.height_m
        climbed = goal.kind is GoalKind.CLIMB and float(vehicle.pos_ned_m[2]) <= climb_to + HEIGHT_REACHED_M
        return GuidanceStatus(
            t_s=now_s,
            goal_number=goal.number,
            horizontal_error_m=None if relative is None else float(np.linalg.norm(relative.error_ne_m)),
            height_above_pad_m=None if relative is None else relative.height_m,
            relative_speed_m_s=None if relative is None else float(np.linalg.norm(relative.relative_ne_m_s)),
            in_cone=self._descent.in_cone,
            committed=self._descent.committed,
            contact=self._contact.contact,
            contact_held_s=self._contact.held_s(now_s),
            search_finished=self._search is not None and self._search.finished,
            anchor_ned_m=self._anchor_ned_m.copy() if goal.kind in (GoalKind.SEARCH, GoalKind.CLIMB) else None,
            climbed=climbed,
            pad_too_fast_m_s=self._too_fast_m_s(relative, now_s),
        )

    def _too_fast_m_s(self, relative: _Relative | None, now_s: float) -> float | None:
        """The pad's speed, once it has been more than the vehicle may fly for TOO_FAST_FOR_S without a doubt."""
        if relative is None:
            self._too_fast_since_s = None
            return None
        speed = float(np.linalg.norm(relative.pad.vel_ned_m_s[:2]))
        sigma = math.sqrt(max(0.0, float(np.trace(relative.pad.covariance[3:5, 3:5]))))
        if speed - 2.0 * sigma <= self._guidance.speed_max_m_s - REACH_MARGIN_M_S:
            self._too_fast_since_s = None
            return None
        since_s = self._too_fast_since_s = now_s if self._too_fast_since_s is None else self._too_fast_since_s
        return speed if now_s - since_s >= TOO_FAST_FOR_S else None
