"""What each phase waits for and does. Pure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.config import MissionConfig
from app.messages import (
    AutopilotAction,
    CommandAnswer,
    CommandResult,
    FlightMode,
    GoalKind,
    LandedState,
    OperatorAction,
    OperatorText,
    Phase,
    Severity,
    VehicleState,
)
from app.mission.endings import run_disarm, run_suspended
from app.mission.modes import REFUSALS_MAX, enter_offboard, hand_over
from app.mission.precland import begin_precland, run_precland, watch_pad
from app.mission.rounds import go_round, lost
from app.mission.search import search_lower, turn_back
from app.mission.states import NO_ARMING_IN, MissionInputs, MissionState, Reason, Transition
from app.mission.transitions import (
    CONFIRM_S,
    anchor_of,
    ask,
    enter_disarm,
    enter_search,
    go,
    guidance_of,
    leave_to_px4,
    numbered,
    stands,
)

SETTLED_ERROR_M = 0.4
SETTLED_SPEED_M_S = 0.5
SETTLED_HEIGHT_M = 0.6
SETTLED_FOR_S = 1.0
MISSED_BELOW_PAD_M = -0.35
"""So far below where the pad is believed to be, the vehicle has sunk past it."""
FALLEN_OFF_S = 1.0
"""Without contact for so long, a vehicle that was on the pad has slid off it."""
COMMITTED_MAX_S = 20.0
"""From the commit to the disarm: 1 s of sinking, and at most 7 s for PX4's land detector (measured at 0.5 m/s)."""


def run_phase(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    """What the present phase makes of the inputs."""
    vehicle = inputs.vehicle
    if vehicle is None:
        return Transition(state)
    match state.phase:
        case Phase.IDLE | Phase.LANDED:
            return Transition(state)
        case Phase.TAKEOFF:
            return _takeoff(state, vehicle, now_s, config)
        case Phase.SEARCH:
            return _search(state, inputs, vehicle, now_s, config)
        case Phase.HOVER:
            return _hover(state, inputs, now_s, config)
        case Phase.TRACK:
            return _track(state, inputs, now_s, config)
        case Phase.LAND:
            return _land(state, inputs, vehicle, now_s, config)
        case Phase.PRECLAND:
            return run_precland(state, inputs, vehicle, now_s, config)
        case Phase.HOLD | Phase.RETURN | Phase.FALLBACK_LAND:
            return hand_over(state, vehicle, now_s)
        case Phase.SUSPENDED:
            return run_suspended(state, inputs, now_s, config)
        case Phase.DISARM:
            return run_disarm(state, vehicle, now_s, config)


def _takeoff(state: MissionState, vehicle: VehicleState, now_s: float, config: MissionConfig) -> Transition:
    if state.refusals >= REFUSALS_MAX or now_s - state.since_s > config.takeoff_timeout_s:
        reason = Reason.REFUSED_BY_AUTOPILOT if state.refusals else Reason.TIMED_OUT
        if not vehicle.armed and not state.arm_asked:
            return go(state, Phase.IDLE, reason, now_s, severity=Severity.WARNING, result=CommandResult.FAILED)
        if not vehicle.armed or stands(vehicle):
            return enter_disarm(state, reason, now_s)
        return leave_to_px4(state, reason, now_s)
    if not vehicle.armed:
        return _arm(replace(state, entry_mode=vehicle.mode), vehicle, now_s)
    if not state.armed_seen:
        state = replace(state, armed_seen=True)
    if not state.takeoff_accepted:
        return ask(state, AutopilotAction.TAKEOFF, now_s, config.search_height_m)
    if vehicle.mode is FlightMode.TAKEOFF:
        # From now on the mode on the ground would be the pilot's.
        state = replace(state, entry_mode=vehicle.mode, takeoff_seen=True)
    ground_down = 0.0 if state.home_ned_m is None else float(state.home_ned_m[2])
    height_m = ground_down - float(vehicle.pos_ned_m[2])
    if height_m >= 0.9 * config.search_height_m and vehicle.landed is LandedState.IN_AIR:
        return enter_search(state, vehicle, Reason.HEIGHT_REACHED, now_s)
    return Transition(state)


def _arm(state: MissionState, vehicle: VehicleState, now_s: float) -> Transition:
    """Have PX4 arm, once for each order: whoever disarms, or refuses to arm, has the last word."""
    if state.armed_seen or state.takeoff_accepted:
        return go(state, Phase.IDLE, Reason.DISARMED, now_s, severity=Severity.WARNING, result=CommandResult.FAILED)
    if not state.arm_asked:
        return ask(state, AutopilotAction.HOLD if vehicle.mode in NO_ARMING_IN else AutopilotAction.ARM, now_s)
    if state.pending is not None or (state.accepted is AutopilotAction.ARM and now_s - state.asked_s < CONFIRM_S):
        return Transition(state)
    # Refused, or it doesn't show: one that was lost on the way may still arrive.
    return enter_disarm(state, Reason.REFUSED_BY_AUTOPILOT, now_s, detail=state.refusal or "PX4 did not arm")


def _search(
    state: MissionState, inputs: MissionInputs, vehicle: VehicleState, now_s: float, config: MissionConfig
) -> Transition:
    if not state.offboard_seen:
        return enter_offboard(state, vehicle, now_s, config)
    if inputs.track_usable:
        return go(
            state,
            Phase.HOVER,
            Reason.PAD_FOUND,
            now_s,
            goal=numbered(state, GoalKind.HOVER, config.hover_height_m),
        )
    if now_s - state.since_s > config.search_timeout_s:
        return search_lower(state, inputs, now_s, config)
    back = turn_back(state, inputs, now_s, config)
    if back is not None:
        return back
    guidance = guidance_of(state, inputs)
    if state.goal.kind is GoalKind.STAY:
        home = vehicle.pos_ned_m + np.array([0.0, 0.0, config.search_height_m])
        ground_down = float(home[2]) if state.home_ned_m is None else float(state.home_ned_m[2])
        anchor = np.array([vehicle.pos_ned_m[0], vehicle.pos_ned_m[1], ground_down])
        drift = (state.command.pad_drives_ne_m_s if state.command is not None else None) or (0.0, 0.0)
        goal = numbered(state, GoalKind.SEARCH, config.search_height_m, anchor, drift)
        return Transition(replace(state, goal=goal))
    if state.goal.kind is GoalKind.CLIMB and guidance is not None and guidance.climbed:
        climb = state.goal
        goal = numbered(state, GoalKind.SEARCH, climb.height_m, anchor_of(state, inputs), climb.drift_ne_m_s)
        return Transition(replace(state, goal=goal))
    if guidance is not None and guidance.search_finished:
        return search_lower(state, inputs, now_s, config)
    return Transition(state)


def _hover(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    gone = lost(state, inputs, now_s, config)
    if gone is not None:
        return gone
    state = _steady(state, inputs, now_s)
    if not _settled(state, now_s):
        if state.command is not None and now_s - state.since_s > config.hover_timeout_s:
            return go_round(state, inputs, Reason.TIMED_OUT, now_s, config)
        return Transition(state)
    if state.command is None:
        return Transition(state)
    if state.command.action is OperatorAction.SEARCH:
        done = CommandAnswer(state.command.number, CommandResult.ACCEPTED)
        text = OperatorText(f"hover: {Reason.SETTLED.value}", Severity.NOTICE)
        return Transition(replace(state, command=None, tries=0), answers=(done,), texts=(text,))
    height_m = state.command.height_m or config.track_height_m
    return go(state, Phase.TRACK, Reason.SETTLED, now_s, goal=numbered(state, GoalKind.TRACK, height_m))


def _track(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    gone = lost(state, inputs, now_s, config)
    if gone is not None:
        return gone
    state = _steady(state, inputs, now_s)
    if inputs.px4_lands:
        state = watch_pad(state, inputs)
    if state.command is None or not _settled(state, now_s):
        if (
            state.command is not None
            and now_s - state.since_s > config.track_time_before_land_s + config.hover_timeout_s
        ):
            return go_round(state, inputs, Reason.TIMED_OUT, now_s, config)
        return Transition(state)
    if state.command.action is OperatorAction.TRACK:
        done = CommandAnswer(state.command.number, CommandResult.ACCEPTED)
        text = OperatorText(f"track: {Reason.TRACK_STEADY.value}", Severity.NOTICE)
        return Transition(replace(state, command=None, tries=0), answers=(done,), texts=(text,))
    if now_s - state.since_s >= config.track_time_before_land_s:
        if inputs.px4_lands:
            return begin_precland(state, inputs, now_s, config)
        return go(state, Phase.LAND, Reason.TRACK_STEADY, now_s, goal=numbered(state, GoalKind.LAND))
    return Transition(state)


def _land(
    state: MissionState, inputs: MissionInputs, vehicle: VehicleState, now_s: float, config: MissionConfig
) -> Transition:
    guidance = guidance_of(state, inputs)
    if guidance is None or not guidance.committed:
        gone = lost(state, inputs, now_s, config)
        if gone is not None:
            return gone
        if now_s - state.since_s > config.land_timeout_s:
            return go_round(state, inputs, Reason.TIMED_OUT, now_s, config)
        return Transition(replace(state, committed_since_s=None, contact_s=None))
    since_s = now_s if state.committed_since_s is None else state.committed_since_s
    contact_s = now_s if guidance.contact else state.contact_s
    state = replace(state, committed_since_s=since_s, contact_s=contact_s)
    height_m = guidance.height_above_pad_m
    # On the ground PX4's height drifts on by decimetres in seconds: only a vehicle that falls has missed.
    falling = contact_s is None or now_s - contact_s > FALLEN_OFF_S
    if height_m is not None and height_m < MISSED_BELOW_PAD_M and falling:
        return go_round(state, inputs, Reason.PAD_MISSED, now_s, config)
    if now_s - since_s > COMMITTED_MAX_S:
        if not guidance.contact:
            return go_round(state, inputs, Reason.TIMED_OUT, now_s, config)
        # It stands on something and nobody disarms: PX4's own landing is the one that can end this.
        return leave_to_px4(state, Reason.TIMED_OUT, now_s)
    if inputs.may_force_disarm:
        return ask(state, AutopilotAction.FORCE_DISARM, now_s)
    if guidance.contact and vehicle.landed is LandedState.ON_GROUND:
        return ask(state, AutopilotAction.DISARM, now_s)
    return Transition(state)


def _steady(state: MissionState, inputs: MissionInputs, now_s: float) -> MissionState:
    """Keep the time since which the vehicle has been near, slow and at its height."""
    guidance = guidance_of(state, inputs)
    steady = (
        guidance is not None
        and guidance.horizontal_error_m is not None
        and guidance.relative_speed_m_s is not None
        and guidance.height_above_pad_m is not None
        and guidance.horizontal_error_m <= SETTLED_ERROR_M
        and guidance.relative_speed_m_s <= SETTLED_SPEED_M_S
        and abs(guidance.height_above_pad_m - state.goal.height_m) <= SETTLED_HEIGHT_M
    )
    if not steady:
        return replace(state, steady_since_s=None)
    return state if state.steady_since_s is not None else replace(state, steady_since_s=now_s)


def _settled(state: MissionState, now_s: float) -> bool:
    return state.steady_since_s is not None and now_s - state.steady_since_s >= SETTLED_FOR_S
