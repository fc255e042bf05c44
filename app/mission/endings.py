"""What comes after a mission, or in place of it: the motors off, an interruption, a hold that is watched, the end of
the application. Pure.

Alight leaves no armed vehicle without a watch: a hold that nobody asked for has a time limit, the safety monitors act
on it, and an interrupted mission goes on only if everything is as it was.
"""

from __future__ import annotations

from dataclasses import replace

from app.config import MissionConfig
from app.messages import (
    AutopilotAction,
    CommandResult,
    FlightMode,
    GoalKind,
    LandedState,
    Phase,
    Response,
    Severity,
    VehicleState,
    Verdict,
)
from app.mission.states import (
    ACTIVE,
    HANDED_OVER,
    IN_OFFBOARD,
    OWN_MODE,
    MissionInputs,
    MissionState,
    Reason,
    Suspended,
    Transition,
)
from app.mission.transitions import ask, enter_disarm, go, guidance_of, leave, numbered, stands

ARM_LATE_S = 1.0
"""An ARM that was sent once takes effect, and shows, within this time. A disarmed vehicle is believed after it."""
DISARM_AGAIN_S = 0.5
"""A vehicle that shows armed after PX4 accepted to disarm it was armed once more: it is asked again at once."""
DISARM_MAX_S = 20.0
FINISH_MAX_S = 8.0
"""An application that is to end finishes a committed landing, or the disarm on the deck, for at most so long."""
UNKNOWN_MODE_MAX_S = 5.0


# ------------------------------------------------------------------------------------------------------- motors off
def run_disarm(state: MissionState, vehicle: VehicleState, now_s: float, config: MissionConfig) -> Transition:
    """Ask PX4 to disarm until the vehicle has shown disarmed for so long that no ARM can be on its way any more."""
    answered = state.asked is AutopilotAction.DISARM and state.pending is None
    if not vehicle.armed and answered and now_s - state.asked_s >= ARM_LATE_S:
        return go(state, Phase.IDLE, Reason.DISARMED, now_s, severity=Severity.NOTICE)
    if vehicle.armed and vehicle.landed is LandedState.IN_AIR and not stands(vehicle):
        # The take-off was quicker than the disarm: PX4 refuses to disarm in the air, and is right.
        return leave(state, Phase.HOLD, Reason.NOT_DISARMED, now_s, config, "in the air already, holding")
    if now_s - state.since_s > DISARM_MAX_S:
        return go(state, Phase.IDLE, Reason.NOT_DISARMED, now_s, severity=Severity.CRITICAL)
    if vehicle.armed and answered and now_s - state.asked_s >= DISARM_AGAIN_S:
        state = replace(state, asked=None, accepted=None)
    elif not vehicle.armed and state.asked is AutopilotAction.DISARM:
        return Transition(state)
    return ask(state, AutopilotAction.DISARM, now_s)


# ------------------------------------------------------------------------------------------------------ interrupted
def suspend(state: MissionState, inputs: MissionInputs, verdict: Verdict, now_s: float) -> Transition:
    """Send nothing more, and remember what was being done."""
    vehicle = inputs.vehicle
    if state.phase is Phase.TAKEOFF and (vehicle is None or not vehicle.armed):
        if state.arm_asked:
            return enter_disarm(state, Reason.SAFETY, now_s, detail=verdict.detail)
        return go(
            state,
            Phase.IDLE,
            Reason.SAFETY,
            now_s,
            detail=verdict.detail,
            severity=Severity.WARNING,
            result=CommandResult.FAILED,
        )
    resets = 0 if vehicle is None else vehicle.frame_resets
    return go(
        state,
        Phase.SUSPENDED,
        Reason.SAFETY,
        now_s,
        detail=verdict.detail,
        severity=Severity.CRITICAL,
        suspended=Suspended(state.phase, state.goal, resets),
    )


def run_suspended(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    """Go on if all is as it was within `resume_within_s`; else leave the vehicle in hold, or to whoever flies it."""
    vehicle, before, verdict = inputs.vehicle, state.suspended, inputs.verdict
    if vehicle is None or before is None or (verdict is not None and verdict.response is Response.STOP_COMMANDING):
        return Transition(state)
    mode, for_s = vehicle.mode, now_s - state.since_s
    if mode is FlightMode.UNKNOWN and for_s < UNKNOWN_MODE_MAX_S:
        return Transition(state)
    as_before = (
        for_s <= config.resume_within_s
        and vehicle.frame_resets == before.frame_resets
        and vehicle.local_position_ok
        and verdict is None
    )
    if as_before and mode in _modes_of(before.phase):
        return _resume(state, before, now_s)
    if mode in (FlightMode.OFFBOARD, FlightMode.HOLD):
        # PX4's own failsafe holds, or is about to. Asked for, it lasts: PX4 would go back to offboard by itself.
        return leave(state, Phase.HOLD, Reason.LINK_WAS_LOST, now_s, config)
    reason = Reason.PX4_FAILSAFE if mode in (FlightMode.LAND, FlightMode.RETURN) else Reason.PILOT_TOOK_OVER
    detail = f"{mode.value} mode by pilot or PX4, hands off"
    result = CommandResult.FAILED
    return go(state, Phase.IDLE, reason, now_s, detail=detail, severity=Severity.WARNING, result=result)


def _modes_of(phase: Phase) -> frozenset[FlightMode]:
    if phase is Phase.TAKEOFF:
        return frozenset({FlightMode.TAKEOFF, FlightMode.HOLD})
    return frozenset({FlightMode.PRECLAND if phase is Phase.PRECLAND else FlightMode.OFFBOARD})


def _resume(state: MissionState, before: Suspended, now_s: float) -> Transition:
    goal = numbered(state, before.goal.kind, before.goal.height_m, before.goal.anchor_ned_m, before.goal.drift_ne_m_s)
    goal = replace(goal, pattern_scale=before.goal.pattern_scale)
    return go(
        state,
        before.phase,
        Reason.RESUMED,
        now_s,
        goal=goal if goal.kind is not GoalKind.NONE else None,
        severity=Severity.WARNING,
        handed_over=before.phase in HANDED_OVER,
    )


# ---------------------------------------------------------------------------------------------------- a watched hold
def watch(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """What a hazard, or the time limit of a hold, makes of a mode of PX4's that Alight left the vehicle in.

    From hold PX4 lands or returns, where the hazard asks for it. A return and a landing are PX4's to finish: it has its
    own failsafes there; only a lost position turns a return into a landing.
    """
    vehicle, verdict = inputs.vehicle, inputs.verdict
    if state.phase not in HANDED_OVER - ACTIVE or not state.handed_over or vehicle is None or not vehicle.armed:
        return None
    if vehicle.mode is not OWN_MODE[state.phase][1] or stands(vehicle):
        return None
    response = None if verdict is None else verdict.response
    if verdict is not None and response is Response.LAND and state.phase is not Phase.FALLBACK_LAND:
        if state.phase is Phase.RETURN and vehicle.local_position_ok:
            return None
        return leave(state, Phase.FALLBACK_LAND, Reason.SAFETY, now_s, config, verdict.detail, Severity.CRITICAL)
    if verdict is not None and response is Response.RETURN and state.phase is Phase.HOLD:
        return leave(state, Phase.RETURN, Reason.SAFETY, now_s, config, verdict.detail, Severity.CRITICAL)
    if state.hold_until_s is None or now_s < state.hold_until_s:
        return None
    phase = {"return": Phase.RETURN, "land": Phase.FALLBACK_LAND}[config.hold_end_action]
    detail = f"held for {config.hold_max_s:.0f} s"
    return leave(state, phase, Reason.HELD_TOO_LONG, now_s, config, detail)


# -------------------------------------------------------------------------------------------- the application's end
def wind_down(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """What becomes of a mission when the application is to end; None: it goes on for now, or there is none.

    On the deck the disarm is finished, and a committed landing too, for FINISH_MAX_S; on the ground the motors are
    switched off; in the air PX4 holds.
    """
    vehicle = inputs.vehicle
    if not inputs.stopping or vehicle is None or state.phase not in ACTIVE | {Phase.SUSPENDED}:
        return None
    since_s = now_s if state.stopping_since_s is None else state.stopping_since_s
    if state.phase in IN_OFFBOARD | {Phase.PRECLAND}:
        guidance = guidance_of(state, inputs)
        finishing = guidance is not None and (guidance.committed or guidance.contact)
        if finishing and now_s - since_s < FINISH_MAX_S:
            return None
        if finishing and guidance is not None and guidance.contact:
            return leave(state, Phase.FALLBACK_LAND, Reason.STOPPED, now_s, config)
    if (vehicle.armed and stands(vehicle)) or (not vehicle.armed and state.arm_asked):
        return enter_disarm(state, Reason.STOPPED, now_s, result=CommandResult.CANCELLED)
    if not vehicle.armed:
        return go(state, Phase.IDLE, Reason.STOPPED, now_s, result=CommandResult.CANCELLED)
    return go(state, Phase.HOLD, Reason.STOPPED, now_s, severity=Severity.WARNING, result=CommandResult.CANCELLED)


def is_wound_down(state: MissionState) -> bool:
    """Whether the vehicle needs the application no more."""
    if state.phase in HANDED_OVER - ACTIVE:
        return state.handed_over
    return state.phase in (Phase.IDLE, Phase.LANDED)
