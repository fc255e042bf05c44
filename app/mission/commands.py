"""The phone's commands: which are taken in which phase, and which are refused, with a reason. Pure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.config import MissionConfig
from app.messages import (
    AutopilotAction,
    CommandAnswer,
    CommandResult,
    GoalKind,
    LandedState,
    OperatorAction,
    OperatorCommand,
    OperatorText,
    Phase,
    Severity,
)
from app.mission.states import ACTIVE, HANDED_OVER, NO_ARMING_IN, MissionInputs, MissionState, Reason, Transition
from app.mission.transitions import anchor_of, enter_search, go, guidance_of, mode_of, numbered

HEIGHT_MIN_M, HEIGHT_MAX_M = 0.5, 50.0
"""Heights that the phone may ask for: those that the configuration may hold (mission.track_height_m)."""
ENDING = frozenset({OperatorAction.HOLD, OperatorAction.ABORT})


def take_command(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """Act on a new command, or None if there is none."""
    command = inputs.command
    if command is None:
        return None
    if command.action in ENDING:
        return _end(state, inputs, command, now_s, config)
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
    if state.phase not in ACTIVE | HANDED_OVER:
        return _refuse(state, command, CommandResult.DENIED, Reason.NO_MISSION.value)
    if guidance is not None and guidance.contact:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, "on the pad already")
    held = command.action is OperatorAction.HOLD
    after = "hold" if held else config.abort_action
    vehicle = inputs.vehicle
    action = None
    if vehicle is not None and not vehicle.armed:
        phase = Phase.IDLE
        if state.asked is AutopilotAction.ARM:  # it may be on its way: motors must not start behind an abort
            action = AutopilotAction.DISARM
    else:
        phase = {"hold": Phase.HOLD, "return": Phase.RETURN, "land": Phase.FALLBACK_LAND}[after]
    reason = Reason.HELD_BY_OPERATOR if held else Reason.ABORTED_BY_OPERATOR
    ended = go(state, phase, reason, now_s, severity=Severity.NOTICE, result=CommandResult.CANCELLED)
    accepted = CommandAnswer(command.number, CommandResult.ACCEPTED)
    return replace(ended, action=action, answers=(*ended.answers, accepted))


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
    if vehicle.armed and vehicle.landed is LandedState.UNKNOWN:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, "in the air or not: unknown")
    in_air = vehicle.armed and vehicle.landed in (LandedState.IN_AIR, LandedState.TAKING_OFF, LandedState.LANDING)
    fresh = replace(state, command=command, tries=0, takeoff_accepted=False, offboard_seen=False)
    if in_air:
        if state.home_ned_m is None:
            ground = vehicle.pos_ned_m + np.array([0.0, 0.0, config.search_height_m])
            fresh = replace(fresh, home_ned_m=ground)
        return enter_search(fresh, vehicle, Reason.ALREADY_FLYING, now_s)
    if not vehicle.armed and not vehicle.armable and vehicle.mode not in NO_ARMING_IN:
        return _refuse(state, command, CommandResult.TEMPORARILY_REJECTED, Reason.NOT_ARMABLE.value)
    home = np.array(vehicle.pos_ned_m)
    return go(
        fresh, Phase.TAKEOFF, Reason.COMMANDED, now_s, home_ned_m=home, ground_known=True, entry_mode=vehicle.mode
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
