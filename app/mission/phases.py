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
from app.mission.states import MissionInputs, MissionState, Reason, Transition
from app.mission.transitions import RETRY_S, ask, enter_search, fail, go, guidance_of, numbered

STREAM_BEFORE_OFFBOARD_S = 0.5
"""PX4 wants setpoints at 2 Hz or more before it enters offboard."""
OFFBOARD_CONFIRM_S = 2.5
"""An accepted change of mode shows in HEARTBEAT within 1 s (measured); more than twice that is a refusal."""
REFUSALS_MAX = 3
SETTLED_ERROR_M = 0.4
SETTLED_SPEED_M_S = 0.5
SETTLED_HEIGHT_M = 0.6
SETTLED_FOR_S = 1.0
LOST_AFTER_S = 1.0
"""Beyond the time at which guidance already brakes: a pad unseen for so long is searched for anew."""
MISSED_BELOW_PAD_M = -0.35
"""So far below where the pad is believed to be, the vehicle has sunk past it."""


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
        case Phase.HOLD:
            return _handed_over(state, vehicle, AutopilotAction.HOLD, FlightMode.HOLD, now_s)
        case Phase.RETURN:
            return _handed_over(state, vehicle, AutopilotAction.RETURN, FlightMode.RETURN, now_s)
        case Phase.FALLBACK_LAND:
            return _handed_over(state, vehicle, AutopilotAction.LAND, FlightMode.LAND, now_s)


def _takeoff(state: MissionState, vehicle: VehicleState, now_s: float, config: MissionConfig) -> Transition:
    if state.refusals >= REFUSALS_MAX or now_s - state.since_s > config.takeoff_timeout_s:
        reason = Reason.REFUSED_BY_AUTOPILOT if state.refusals else Reason.TIMED_OUT
        if not vehicle.armed:
            return go(state, Phase.IDLE, reason, now_s, severity=Severity.WARNING, result=CommandResult.FAILED)
        return go(state, Phase.FALLBACK_LAND, reason, now_s, severity=Severity.WARNING, result=CommandResult.FAILED)
    if not vehicle.armed:
        if state.takeoff_accepted:  # armed, took the command, and disarmed again: PX4 gave up
            return go(state, Phase.IDLE, Reason.DISARMED, now_s, result=CommandResult.FAILED)
        return ask(state, AutopilotAction.ARM, now_s)
    if not state.takeoff_accepted:
        return ask(state, AutopilotAction.TAKEOFF, now_s, config.search_height_m)
    ground_down = 0.0 if state.home_ned_m is None else float(state.home_ned_m[2])
    height_m = ground_down - float(vehicle.pos_ned_m[2])
    if height_m >= 0.9 * config.search_height_m and vehicle.landed is LandedState.IN_AIR:
        return enter_search(state, vehicle, Reason.HEIGHT_REACHED, now_s)
    return Transition(state)


def _search(
    state: MissionState, inputs: MissionInputs, vehicle: VehicleState, now_s: float, config: MissionConfig
) -> Transition:
    if not state.offboard_seen:
        return _enter_offboard(state, vehicle, now_s, config)
    if inputs.track_usable:
        return go(
            state,
            Phase.HOVER,
            Reason.PAD_FOUND,
            now_s,
            goal=numbered(state, GoalKind.HOVER, config.hover_height_m),
        )
    if now_s - state.since_s > config.search_timeout_s:
        return fail(state, Reason.PAD_NOT_FOUND, now_s, config)
    guidance = guidance_of(state, inputs)
    if state.goal.kind is GoalKind.STAY:
        home = vehicle.pos_ned_m + np.array([0.0, 0.0, config.search_height_m])
        ground_down = float(home[2]) if state.home_ned_m is None else float(state.home_ned_m[2])
        anchor = np.array([vehicle.pos_ned_m[0], vehicle.pos_ned_m[1], ground_down])
        goal = numbered(state, GoalKind.SEARCH, config.search_height_m, anchor)
        return Transition(replace(state, goal=goal))
    if state.goal.kind is GoalKind.CLIMB and guidance is not None and guidance.climbed:
        goal = numbered(state, GoalKind.SEARCH, config.search_height_m, state.goal.anchor_ned_m)
        return Transition(replace(state, goal=goal))
    if guidance is not None and guidance.search_finished:
        return fail(state, Reason.PAD_NOT_FOUND, now_s, config)
    return Transition(state)


def _enter_offboard(state: MissionState, vehicle: VehicleState, now_s: float, config: MissionConfig) -> Transition:
    if vehicle.mode is FlightMode.OFFBOARD and state.pending is None:
        return Transition(replace(state, offboard_seen=True, refusals=0))
    if state.refusals >= REFUSALS_MAX:
        return fail(state, Reason.REFUSED_BY_AUTOPILOT, now_s, config, "PX4 refused offboard")
    waited_s = now_s - max(state.since_s + STREAM_BEFORE_OFFBOARD_S, state.asked_s)
    if state.asked_s < state.since_s:
        return ask(state, AutopilotAction.OFFBOARD, now_s) if waited_s >= 0 else Transition(state)
    if state.pending is None and waited_s > (OFFBOARD_CONFIRM_S if state.refusals == 0 else RETRY_S):
        silent = replace(state, refusals=state.refusals + (1 if state.refusals == 0 else 0))
        return ask(silent, AutopilotAction.OFFBOARD, now_s)
    return Transition(state)


def _hover(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    lost = _lost(state, inputs, now_s, config)
    if lost is not None:
        return lost
    state = _steady(state, inputs, now_s)
    if not _settled(state, now_s):
        if state.command is not None and now_s - state.since_s > config.hover_timeout_s:
            return _go_round(state, inputs, Reason.TIMED_OUT, now_s, config)
        return Transition(state)
    if state.command is None:
        return Transition(state)
    if state.command.action is OperatorAction.SEARCH:
        done = CommandAnswer(state.command.number, CommandResult.ACCEPTED)
        text = OperatorText(f"hover: {Reason.SETTLED.value}", Severity.NOTICE)
        return Transition(replace(state, command=None), answers=(done,), texts=(text,))
    height_m = state.command.height_m or config.track_height_m
    return go(state, Phase.TRACK, Reason.SETTLED, now_s, goal=numbered(state, GoalKind.TRACK, height_m))


def _track(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    lost = _lost(state, inputs, now_s, config)
    if lost is not None:
        return lost
    state = _steady(state, inputs, now_s)
    if state.command is None or not _settled(state, now_s):
        if (
            state.command is not None
            and now_s - state.since_s > config.track_time_before_land_s + config.hover_timeout_s
        ):
            return _go_round(state, inputs, Reason.TIMED_OUT, now_s, config)
        return Transition(state)
    if state.command.action is OperatorAction.TRACK:
        done = CommandAnswer(state.command.number, CommandResult.ACCEPTED)
        text = OperatorText(f"track: {Reason.TRACK_STEADY.value}", Severity.NOTICE)
        return Transition(replace(state, command=None), answers=(done,), texts=(text,))
    if now_s - state.since_s >= config.track_time_before_land_s:
        return go(state, Phase.LAND, Reason.TRACK_STEADY, now_s, goal=numbered(state, GoalKind.LAND))
    return Transition(state)


def _land(
    state: MissionState, inputs: MissionInputs, vehicle: VehicleState, now_s: float, config: MissionConfig
) -> Transition:
    guidance = guidance_of(state, inputs)
    if guidance is None:
        return Transition(state)
    if not guidance.committed:
        lost = _lost(state, inputs, now_s, config)
        if lost is not None:
            return lost
        if now_s - state.since_s > config.land_timeout_s:
            return _go_round(state, inputs, Reason.TIMED_OUT, now_s, config)
        return Transition(state)
    height_m = guidance.height_above_pad_m
    if height_m is not None and height_m < MISSED_BELOW_PAD_M:
        return _go_round(state, inputs, Reason.PAD_MISSED, now_s, config)
    if inputs.may_force_disarm:
        return ask(state, AutopilotAction.FORCE_DISARM, now_s)
    if guidance.contact and vehicle.landed is LandedState.ON_GROUND:
        return ask(state, AutopilotAction.DISARM, now_s)
    return Transition(state)


def _handed_over(
    state: MissionState, vehicle: VehicleState, action: AutopilotAction, mode: FlightMode, now_s: float
) -> Transition:
    """Ask PX4 for a mode of its own until it has taken it up or refused it too often; from then on it flies."""
    if state.handed_over:
        return Transition(state)
    if vehicle.mode is mode:
        return Transition(replace(state, handed_over=True))
    if state.refusals >= REFUSALS_MAX:
        words = OperatorText(f"{state.phase.value}: PX4 refused, it is in {vehicle.mode.value}"[:50], Severity.CRITICAL)
        return Transition(replace(state, handed_over=True), texts=(words,))
    return ask(state, action, now_s)


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


def _lost(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    track = inputs.track
    if track is not None and now_s - track.t_last_fix_s <= LOST_AFTER_S:
        return None
    return _go_round(state, inputs, Reason.PAD_LOST, now_s, config)


def _go_round(
    state: MissionState, inputs: MissionInputs, reason: Reason, now_s: float, config: MissionConfig
) -> Transition:
    """Climb to the search height over where the pad is expected, and search again; a limited number of times."""
    if state.tries + 1 >= config.landing_tries:
        return fail(state, Reason.TRIES_USED_UP, now_s, config, f"{Reason.TRIES_USED_UP.value}: {reason.value}")
    vehicle, track = inputs.vehicle, inputs.track
    anchor = np.zeros(3) if vehicle is None else np.array(vehicle.pos_ned_m)
    if track is not None:
        anchor = np.array(track.at(now_s).pos_ned_m)
    if state.home_ned_m is not None and track is None:
        anchor[2] = state.home_ned_m[2]
    goal = numbered(state, GoalKind.CLIMB, config.search_height_m, anchor)
    return go(state, Phase.SEARCH, reason, now_s, goal=goal, severity=Severity.WARNING, tries=state.tries + 1)
