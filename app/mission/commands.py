"""The phone's commands: which are taken in which phase, and which are refused, with a reason. Pure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.config import MissionConfig
from app.messages import (
    CommandAnswer,
    CommandResult,
    FlightMode,
    GoalKind,
    LandedState,
    OperatorAction,
    OperatorCommand,
    OperatorText,
    Phase,
    Severity,
    VehicleState,
)
from app.mission.states import (
    ACTIVE,
    HANDED_OVER,
    NO_ARMING_IN,
    OWN_MODE,
    MissionInputs,
    MissionState,
    Reason,
    Transition,
)
from app.mission.transitions import anchor_of, enter_search, go, guidance_of, mode_of, numbered, stands

HEIGHT_MIN_M, HEIGHT_MAX_M = 0.5, 50.0
"""Heights that the phone may ask for: those that the configuration may hold (mission.track_height_m)."""
LOCKED_FOR_S = 30.0
"""After a landing the order that led to it starts no motors again for so long: somebody walks up to the vehicle."""
ENDING = frozenset({OperatorAction.HOLD, OperatorAction.ABORT})


def take_command(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """Act on a new command, or None if there is none."""
    command = inputs.command
    if command is None:
        return None
    if command.action in ENDING:
        return _end(state, inputs, command, now_s, config)
    if command.repeated:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, "first copy not heard, send it anew")
    if inputs.stopping:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, Reason.STOPPED.value)
    return _begin(state, inputs, command, now_s, config)


def refuse_beginning(ended: Transition, inputs: MissionInputs) -> Transition | None:
    """The answer to a SEARCH, TRACK or LAND that came in the very step that ended the mission; None for another."""
    command = inputs.command
    if command is None or command.action in ENDING:
        return None
    words = "" if ended.reason is None else ended.reason.value
    return _refuse(ended.state, command, CommandResult.TEMPORARILY_REJECTED, words)


def _refuse(state: MissionState, command: OperatorCommand, result: CommandResult, words: str) -> Transition:
    text = OperatorText(f"{command.action.name.lower()} refused: {words}"[:50], Severity.WARNING)
    return Transition(state, answers=(CommandAnswer(command.number, result),), texts=(text,))


def _cancelled(state: MissionState) -> tuple[CommandAnswer, ...]:
    return () if state.command is None else (CommandAnswer(state.command.number, CommandResult.CANCELLED),)


def _end(
    state: MissionState, inputs: MissionInputs, command: OperatorCommand, now_s: float, config: MissionConfig
) -> Transition:
    """HOLD and ABORT: obeyed in flight up to contact, also when the landing is committed."""
    guidance = guidance_of(state, inputs)
    accepted = CommandAnswer(command.number, CommandResult.ACCEPTED)
    if state.phase is Phase.DISARM:
        return Transition(state, answers=(accepted,))  # nothing is safer than that
    if state.phase not in ACTIVE | HANDED_OVER | {Phase.SUSPENDED}:
        return _refuse(state, command, CommandResult.DENIED, Reason.NO_MISSION.value)
    if guidance is not None and guidance.contact:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, "on the pad already")
    held = command.action is OperatorAction.HOLD
    after = "hold" if held else config.abort_action
    vehicle = inputs.vehicle
    phase = {"hold": Phase.HOLD, "return": Phase.RETURN, "land": Phase.FALLBACK_LAND}[after]
    if vehicle is not None and not vehicle.armed:
        # An ARM may be on its way: motors must not start behind an abort.
        phase = Phase.DISARM if state.arm_asked and not state.armed_seen else Phase.IDLE
    elif vehicle is not None and stands(vehicle):
        phase = Phase.DISARM  # a return would take off
    reason = Reason.HELD_BY_OPERATOR if held else Reason.ABORTED_BY_OPERATOR
    ended = go(state, phase, reason, now_s, severity=Severity.NOTICE, result=CommandResult.CANCELLED)
    return replace(ended, answers=(*ended.answers, accepted))


def _begin(
    state: MissionState, inputs: MissionInputs, command: OperatorCommand, now_s: float, config: MissionConfig
) -> Transition:
    """SEARCH, TRACK and LAND: begin a mission, or change the aim of the one that flies."""
    vehicle = inputs.vehicle
    if vehicle is None or (inputs.verdict is not None and state.phase not in ACTIVE):
        words = "no autopilot" if inputs.verdict is None else inputs.verdict.detail
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, words)
    if command.height_m and not HEIGHT_MIN_M <= command.height_m <= HEIGHT_MAX_M:
        words = f"{command.height_m:.3g} m not in {HEIGHT_MIN_M:g}..{HEIGHT_MAX_M:g}"
        return _refuse(state, command, CommandResult.DENIED, words)
    if state.phase in ACTIVE:
        return _change_aim(state, inputs, command, now_s, config)
    if state.phase in HANDED_OVER and not state.handed_over:
        # Its change of mode is on the way: asking for offboard now would race with it.
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, f"on the way to {state.phase.value}")
    why_not = _why_not(state, vehicle, command, now_s)
    if why_not:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, why_not)
    fresh = replace(
        state,
        command=command,
        last_order=command,
        tries=0,
        arm_asked=False,
        armed_seen=False,
        takeoff_accepted=False,
        takeoff_seen=False,
        offboard_seen=False,
    )
    if _in_air(vehicle):
        if state.home_ned_m is None:
            ground = vehicle.pos_ned_m + np.array([0.0, 0.0, config.search_height_m])
            fresh = replace(fresh, home_ned_m=ground)
        return enter_search(fresh, vehicle, Reason.ALREADY_FLYING, now_s)
    if not vehicle.armed and not vehicle.armable and vehicle.mode not in NO_ARMING_IN:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, Reason.NOT_ARMABLE.value)
    if not vehicle.armed and not command.trusted:
        refused = _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, "")
        text = OperatorText(f"{command.action.name.lower()}: motors will start, send it again", Severity.WARNING)
        asked = tuple(replace(answer, asks_confirmation=True) for answer in refused.answers)
        return replace(refused, answers=asked, texts=(text,))
    home = np.array(vehicle.pos_ned_m)
    return go(
        fresh, Phase.TAKEOFF, Reason.COMMANDED, now_s, home_ned_m=home, ground_known=True, entry_mode=vehicle.mode
    )


def _in_air(vehicle: VehicleState) -> bool:
    return vehicle.armed and vehicle.landed in (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING)


def _why_not(state: MissionState, vehicle: VehicleState, command: OperatorCommand, now_s: float) -> str:
    """Why no mission may begin now; "" if one may. PX4's failsafes and the pilot keep what they have."""
    if state.phase in (Phase.SUSPENDED, Phase.DISARM):
        return f"{state.phase.value}: wait"
    if state.phase is Phase.LANDED and not command.takes_over and _same_order(command, state.last_order):
        wait_s = LOCKED_FOR_S - (now_s - state.since_s)
        if wait_s > 0.0:
            return f"just landed, wait {wait_s:.0f} s"
    if not vehicle.armed:
        return ""
    if vehicle.landed is LandedState.UNKNOWN:
        return "in the air or not: unknown"
    mode = vehicle.mode
    if vehicle.failsafe:
        return f"PX4 is in a failsafe ({mode.value})"
    own = OWN_MODE[state.phase][1] if state.phase in HANDED_OVER else None
    if mode is own:
        return ""
    if mode in (FlightMode.LAND, FlightMode.RETURN):
        return f"PX4 is in {mode.value} mode"
    if command.takes_over:
        return ""
    if not _in_air(vehicle):
        return "armed on the ground, disarm first"
    return "" if mode is FlightMode.HOLD else f"{mode.value} mode is the pilot's"


def _same_order(command: OperatorCommand, last: OperatorCommand | None) -> bool:
    """Whether an order asks for the same as the one before: it may be a late copy of it."""
    return last is not None and (command.action, command.height_m, command.sender) == (
        last.action,
        last.height_m,
        last.sender,
    )


def _change_aim(
    state: MissionState, inputs: MissionInputs, command: OperatorCommand, now_s: float, config: MissionConfig
) -> Transition:
    guidance = guidance_of(state, inputs)
    if guidance is not None and guidance.committed:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, Reason.COMMITTED.value)
    cancelled = _cancelled(state)
    taken = replace(state, command=command)
    height_m = command.height_m or config.track_height_m
    if state.phase is Phase.PRECLAND and command.action is not OperatorAction.LAND and inputs.vehicle is not None:
        changed = enter_search(taken, inputs.vehicle, Reason.COMMANDED, now_s)
        # PX4 flies, or is about to: offboard comes first.
        searching = replace(changed.state, entry_mode=mode_of(state))
        return replace(changed, state=searching, answers=(*cancelled, *changed.answers))
    if state.phase in (Phase.LAND, Phase.TRACK) and command.action is not OperatorAction.LAND:
        kind, phase = (
            (GoalKind.TRACK, Phase.TRACK) if command.action is OperatorAction.TRACK else (GoalKind.HOVER, Phase.HOVER)
        )
        height_m = height_m if kind is GoalKind.TRACK else config.hover_height_m
        changed = go(taken, phase, Reason.COMMANDED, now_s, goal=numbered(taken, kind, height_m))
        return replace(changed, answers=(*cancelled, *changed.answers))
    # TAKEOFF, SEARCH and HOVER lead to every aim; TRACK leads on to LAND: the phase goes on with the new command.
    answers = (*cancelled, CommandAnswer(command.number, CommandResult.IN_PROGRESS, 5))
    words = f"{state.phase.value}: on to {command.action.name.lower()}"
    since = replace(taken, since_s=now_s) if state.phase in (Phase.TRACK, Phase.HOVER) else taken
    if command.pad_drives_ne_m_s is not None and state.goal.kind in (GoalKind.SEARCH, GoalKind.CLIMB):
        goal = state.goal
        along = numbered(state, goal.kind, goal.height_m, anchor_of(state, inputs), command.pad_drives_ne_m_s)
        since = replace(since, goal=replace(along, pattern_scale=goal.pattern_scale), since_s=now_s, left_behind_s=None)
    return Transition(since, answers=answers, texts=(OperatorText(words[:50]),))
