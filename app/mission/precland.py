"""PRECLAND: PX4 lands by its own precision landing, and Alight tells it where the pad is. Pure.

For pads at rest. The targets flow before PX4 is asked for the mode, so that it sees one when it looks for it first, and
velocity setpoints until it has taken the mode up. The pilot, the phone and the safety monitors stay in force.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from app.config import MissionConfig
from app.messages import AutopilotAction, FlightMode, GoalKind, GuidanceStatus, PadTrack, Phase, VehicleState
from app.mission.modes import REFUSALS_MAX, hand_over
from app.mission.rounds import go_round, lost
from app.mission.states import MissionInputs, MissionState, PadWatch, Reason, Transition
from app.mission.transitions import CONFIRM_S, fail, go, guidance_of, leave_to_px4, numbered

TARGETS_BEFORE_S = 0.5
"""Ten targets, before PX4 is asked for the mode."""
MOVING_M_S = 0.3
"""A pad that is faster by two standard deviations moves: in the second that PX4 waits over it, it would leave PX4's
radius of 0.2 m."""
WATCH_S = 2.5
"""The way that a pad makes in this time tells its speed without PX4's velocity, whose error of up to 0.7 m/s (on the
ground and near it) is all in the track's."""
BESIDE_BELOW_M, BESIDE_M = 0.8, 0.4
"""So low, and so far off the pad's centre, PX4 is about to come down beside the pad: with its velocity 0.5 m/s wrong it
touched the ground 0.7 m off. A change of mode and the turn from sinking to climbing take half a metre. Lower still a
landing that is nearer than this is committed (COMMIT_ERROR_M of guidance's precland)."""
COMMITTED_MAX_S = 30.0
"""From the commit to the disarm: PX4 sinks at 0.3 m/s near the ground, and its land detector then took up to 15 s."""


def speed_if_moving_m_s(track: PadTrack) -> float | None:
    """The pad's speed over ground if it moves beyond doubt, else None."""
    speed_m_s = math.hypot(track.vel_ned_m_s[0], track.vel_ned_m_s[1])
    sigma_m_s = math.sqrt(max(0.0, float(np.linalg.eigvalsh(track.covariance[3:5, 3:5])[-1])))
    return speed_m_s if speed_m_s - 2.0 * sigma_m_s > MOVING_M_S else None


def watch_pad(state: MissionState, inputs: MissionInputs) -> MissionState:
    """Keep how fast the pad has gone from one place to another lately, whatever PX4's velocity says."""
    track, watch = inputs.track, state.watch
    if track is None:
        return state
    at, t_s = (float(track.pos_ned_m[0]), float(track.pos_ned_m[1])), track.t_capture_s
    if watch is None:
        return replace(state, watch=PadWatch(t_s, at))
    if t_s - watch.since_s < WATCH_S:
        return state
    return replace(state, watch=PadWatch(t_s, at, math.dist(at, watch.from_ne_m) / (t_s - watch.since_s)))


def begin_precland(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    """Enter PRECLAND, or end the mission over a pad that moves."""
    refused = _refuse_moving(state, inputs, now_s, config)
    if refused is not None:
        return refused
    guidance = guidance_of(state, inputs)
    height_m = state.goal.height_m
    if guidance is not None and guidance.height_above_pad_m is not None:
        height_m = guidance.height_above_pad_m
    goal = numbered(state, GoalKind.PRECLAND, height_m)
    return go(state, Phase.PRECLAND, Reason.TRACK_STEADY, now_s, goal=goal)


def run_precland(
    state: MissionState, inputs: MissionInputs, vehicle: VehicleState, now_s: float, config: MissionConfig
) -> Transition:
    """Hand over to PX4, and watch it land."""
    guidance = guidance_of(state, inputs)
    state = watch_pad(state, inputs)
    if guidance is None or not guidance.committed:
        ended = lost(state, inputs, now_s, config) or _refuse_moving(state, inputs, now_s, config)
        if ended is not None:
            return ended
        if guidance is not None and _comes_down_beside(guidance):
            return go_round(state, inputs, Reason.PAD_MISSED, now_s, config)
        if now_s - state.since_s > config.land_timeout_s:
            return go_round(state, inputs, Reason.TIMED_OUT, now_s, config)
        state = replace(state, committed_since_s=None)
    else:
        since_s = now_s if state.committed_since_s is None else state.committed_since_s
        state = replace(state, committed_since_s=since_s)
        if now_s - since_s > COMMITTED_MAX_S:
            return leave_to_px4(state, Reason.TIMED_OUT, now_s)
    if now_s - state.since_s < TARGETS_BEFORE_S:
        return Transition(state)
    unseen = state.accepted is AutopilotAction.PRECLAND and now_s - state.asked_s >= CONFIRM_S
    if state.refusals + unseen >= REFUSALS_MAX and vehicle.mode in (FlightMode.OFFBOARD, FlightMode.UNKNOWN):
        return fail(state, Reason.REFUSED_BY_AUTOPILOT, now_s, config, "PX4 refused its precision landing")
    return hand_over(state, vehicle, now_s)


def _comes_down_beside(guidance: GuidanceStatus) -> bool:
    """Whether PX4 has sunk low beside the pad."""
    off_m, height_m = guidance.horizontal_error_m, guidance.height_above_pad_m
    return off_m is not None and height_m is not None and height_m < BESIDE_BELOW_M and off_m > BESIDE_M


def _refuse_moving(
    state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig
) -> Transition | None:
    speed_m_s = None if inputs.track is None else speed_if_moving_m_s(inputs.track)
    way_m_s = None if state.watch is None else state.watch.speed_m_s
    if speed_m_s is None or way_m_s is None or way_m_s < MOVING_M_S:
        return None
    return fail(state, Reason.PAD_MOVES, now_s, config, f"pad moves at {speed_m_s:.1f} m/s, PX4 can't follow it")
