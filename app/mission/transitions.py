"""The building blocks of a decision: enter a phase, number a goal, ask for an action. Pure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.config import MissionConfig
from app.frames import Array
from app.messages import (
    AutopilotAction,
    CommandAnswer,
    CommandResult,
    FlightMode,
    Goal,
    GoalKind,
    GuidanceStatus,
    LandedState,
    OperatorText,
    Phase,
    Severity,
    VehicleState,
)
from app.mission.states import HANDED_OVER, IN_OFFBOARD, OWN_MODE, MissionInputs, MissionState, Reason, Transition

PROGRESS = {Phase.TAKEOFF: 10, Phase.SEARCH: 30, Phase.HOVER: 50, Phase.TRACK: 65, Phase.LAND: 80, Phase.PRECLAND: 80}
"""What the phone is told of a mission's progress, in percent, when it enters a phase."""
RETRY_S = 1.0
"""An action that was refused is asked for again after this long."""
CONFIRM_S = 2.5
"""What PX4 accepted shows in its telemetry within 1 s (measured); after more than twice that it did not happen."""


def go(
    state: MissionState,
    phase: Phase,
    reason: Reason,
    now_s: float,
    *,
    goal: Goal | None = None,
    detail: str = "",
    severity: Severity = Severity.INFO,
    result: CommandResult | None = None,
    **changes: object,
) -> Transition:
    """Enter a phase. `result` ends the command with that answer; else a running one is answered with its progress.

    A mission that is over leaves no home behind: the next one may begin elsewhere, over other ground.
    """
    answers: tuple[CommandAnswer, ...] = ()
    command = state.command
    if command is not None and result is not None:
        answers, command = (CommandAnswer(command.number, result),), None
    elif command is not None and phase in PROGRESS:
        answers = (CommandAnswer(command.number, CommandResult.IN_PROGRESS, PROGRESS[phase]),)
    entered = replace(
        state,
        phase=phase,
        since_s=now_s,
        goal=goal or numbered(state, GoalKind.NONE),
        command=command,
        home_ned_m=None if phase in (Phase.IDLE, Phase.LANDED) else state.home_ned_m,
        ground_known=phase not in (Phase.IDLE, Phase.LANDED) and state.ground_known,
        search_passes=0,
        left_behind_s=None,
        pending=None,
        asked=None,
        accepted=None,
        refusals=0,
        entry_mode=mode_of(state) if phase in HANDED_OVER else state.entry_mode,
        handed_over=False,
        steady_since_s=None,
        committed_since_s=None,
        contact_s=None,
        watch=None,
        hold_until_s=None,
        suspended=None,
    )
    entered = replace(entered, **changes)  # type: ignore[arg-type]  # field names are checked by replace itself
    text = f"{phase.value}: {detail or reason.value}"
    return Transition(entered, reason, answers=answers, texts=(OperatorText(text[:50], severity),))


def mode_of(state: MissionState) -> FlightMode:
    """The mode that PX4 flies in this state, or is about to, as far as Alight asked for it: what was asked for may show
    up to a second later.
    """
    if state.phase in HANDED_OVER:
        action, own = OWN_MODE[state.phase]
        if state.handed_over or state.asked is action:
            return own
    return FlightMode.OFFBOARD if state.phase in IN_OFFBOARD and state.offboard_seen else state.entry_mode


def numbered(
    state: MissionState,
    kind: GoalKind,
    height_m: float = 0.0,
    anchor_ned_m: Array | None = None,
    drift_ne_m_s: tuple[float, float] = (0.0, 0.0),
) -> Goal:
    """A new goal, with the next number."""
    anchor = np.zeros(3) if anchor_ned_m is None else anchor_ned_m
    return Goal(kind, height_m, anchor, state.goal.number + 1, drift_ne_m_s)


def fail(state: MissionState, reason: Reason, now_s: float, config: MissionConfig, detail: str = "") -> Transition:
    """End the mission by the configured failure action."""
    phase = {"hold": Phase.HOLD, "return": Phase.RETURN, "land": Phase.FALLBACK_LAND}[config.failure_action]
    return leave(state, phase, reason, now_s, config, detail)


def leave(
    state: MissionState,
    phase: Phase,
    reason: Reason,
    now_s: float,
    config: MissionConfig,
    detail: str = "",
    severity: Severity = Severity.WARNING,
) -> Transition:
    """End the mission, as failed, by a mode of PX4's own. A hold that nobody asked for has a time limit."""
    until_s = now_s + config.hold_max_s if phase is Phase.HOLD else None
    return go(
        state,
        phase,
        reason,
        now_s,
        detail=detail,
        severity=severity,
        result=CommandResult.FAILED,
        hold_until_s=until_s,
    )


def enter_disarm(
    state: MissionState, reason: Reason, now_s: float, *, result: CommandResult = CommandResult.FAILED, detail: str = ""
) -> Transition:
    """End the mission on the ground, with the motors off beyond doubt."""
    return go(state, Phase.DISARM, reason, now_s, detail=detail, severity=Severity.WARNING, result=result)


STANDS_M_S = 0.5
"""A vehicle on the ground whose velocity PX4 gives as more than this is not believed to stand there."""


def stands(vehicle: VehicleState) -> bool:
    """Whether the vehicle stands on something, by PX4's own land detector and velocity. NaN is no."""
    return vehicle.landed is LandedState.ON_GROUND and float(np.linalg.norm(vehicle.vel_ned_m_s)) <= STANDS_M_S


def leave_to_px4(state: MissionState, reason: Reason, now_s: float) -> Transition:
    """End the mission by PX4's own landing, straight down."""
    return go(state, Phase.FALLBACK_LAND, reason, now_s, severity=Severity.WARNING, result=CommandResult.FAILED)


def ask(state: MissionState, action: AutopilotAction, now_s: float, height_m: float = 0.0) -> Transition:
    """Ask for an action, unless one is pending, this one was refused a moment ago, or it was accepted and has not had
    the time to show. One that was accepted and doesn't show counts as refused.
    """
    if state.pending is not None:
        return Transition(state)
    unseen = state.accepted is action
    wait_s = CONFIRM_S if unseen else RETRY_S if state.refusals and state.asked is action else 0.0
    if now_s - state.asked_s < wait_s:
        return Transition(state)
    asked = replace(
        state,
        pending=action,
        asked=action,
        asked_s=now_s,
        accepted=None,
        refusals=state.refusals + (1 if unseen else 0),
        arm_asked=state.arm_asked or action is AutopilotAction.ARM,
    )
    return Transition(asked, action=action, action_height_m=height_m)


def enter_search(state: MissionState, vehicle: VehicleState, reason: Reason, now_s: float) -> Transition:
    """Begin with a stream of zero velocity; offboard and the pattern follow."""
    return go(
        state,
        Phase.SEARCH,
        reason,
        now_s,
        goal=numbered(state, GoalKind.STAY),
        entry_mode=vehicle.mode,
        offboard_seen=False,
    )


def guidance_of(state: MissionState, inputs: MissionInputs) -> GuidanceStatus | None:
    """The controller's word, if it is about the present goal."""
    guidance = inputs.guidance
    return guidance if guidance is not None and guidance.goal_number == state.goal.number else None


def anchor_of(state: MissionState, inputs: MissionInputs) -> Array:
    """(3,) where the goal's anchor is now, in PX4's present local frame: it drifts."""
    guidance = guidance_of(state, inputs)
    if guidance is None or guidance.anchor_ned_m is None:
        return np.array(state.goal.anchor_ned_m)
    anchor = np.array(guidance.anchor_ned_m)
    return anchor if guidance.frame_s is None else anchor + state.jumps.since(guidance.frame_s)
