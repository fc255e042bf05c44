"""What comes before any phase: answers to actions, the end of the flight, the pilot, safety. Pure."""

from __future__ import annotations

from dataclasses import replace

from app.config import MissionConfig
from app.messages import (
    AutopilotAction,
    CommandResult,
    FlightMode,
    LandedState,
    Phase,
    Response,
    Severity,
    VehicleState,
)
from app.mission.states import (
    ACTIVE,
    HANDED_OVER,
    IN_OFFBOARD,
    OWN_MODE,
    MissionInputs,
    MissionState,
    Reason,
    Transition,
)
from app.mission.transitions import fail, go, guidance_of

ANSWER_MAX_S = 40.0
"""Beyond the longest time limit of an action: an answer that has not come by then never will."""


def take_results(state: MissionState, inputs: MissionInputs, now_s: float) -> MissionState:
    """The state with what the autopilot answered to the action that is pending; other answers are stale."""
    for result in inputs.results:
        if result.action is not state.pending:
            continue
        taken_off = result.ok and result.action is AutopilotAction.TAKEOFF
        state = replace(
            state,
            pending=None,
            accepted=result.action if result.ok else None,
            refusals=state.refusals if result.ok else state.refusals + 1,
            takeoff_accepted=state.takeoff_accepted or taken_off,
        )
    if state.pending is not None and now_s - state.asked_s > ANSWER_MAX_S:
        state = replace(state, pending=None, refusals=state.refusals + 1)
    return state


def end_of_flight(state: MissionState, inputs: MissionInputs, now_s: float) -> Transition | None:
    """Disarmed while flying: on the pad that is the aim, anywhere else the end of the mission."""
    vehicle = inputs.vehicle
    if vehicle is None or vehicle.armed or state.phase not in IN_OFFBOARD | HANDED_OVER:
        return None
    guidance = guidance_of(state, inputs)
    if state.phase in (Phase.LAND, Phase.PRECLAND) and guidance is not None and guidance.committed:
        return go(state, Phase.LANDED, Reason.TOUCHDOWN, now_s, severity=Severity.NOTICE, result=CommandResult.ACCEPTED)
    return go(state, Phase.IDLE, Reason.DISARMED, now_s, severity=Severity.NOTICE, result=CommandResult.FAILED)


def pilot(state: MissionState, inputs: MissionInputs, now_s: float) -> Transition | None:
    """Hands off, the moment PX4 is in a mode that Alight did not ask for."""
    vehicle = inputs.vehicle
    if vehicle is None or not vehicle.armed or state.phase not in ACTIVE | HANDED_OVER:
        return None
    mode = vehicle.mode
    if mode is FlightMode.UNKNOWN or mode in _ours(state) or _disarms(state, vehicle):
        return None
    return go(
        state,
        Phase.IDLE,
        Reason.PILOT_TOOK_OVER,
        now_s,
        detail=f"{mode.value} mode by pilot or PX4, hands off",
        severity=Severity.WARNING,
        result=CommandResult.CANCELLED,
    )


def _disarms(state: MissionState, vehicle: VehicleState) -> bool:
    """On the pad PX4 goes back to the mode before its precision landing as it disarms, which shows up to a second
    later. Nothing is commanded meanwhile.
    """
    on_pad = state.committed_since_s is not None and vehicle.landed is LandedState.ON_GROUND
    return state.phase is Phase.PRECLAND and state.handed_over and on_pad and vehicle.mode is FlightMode.OFFBOARD


def _ours(state: MissionState) -> set[FlightMode]:
    """The modes that are no sign of the pilot: the one asked for, and until that shows, the one before it."""
    if state.phase is Phase.TAKEOFF:
        # PX4's take-off ends in hold. The mode on the ground counts until PX4 is seen to take off, and no longer.
        return {FlightMode.TAKEOFF, FlightMode.HOLD, state.entry_mode}
    if state.phase in HANDED_OVER:
        _, own = OWN_MODE[state.phase]
        if state.handed_over:
            return {own}
        return {own, state.entry_mode, FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD}
    if state.offboard_seen:
        return {FlightMode.OFFBOARD}
    after_takeoff = {FlightMode.HOLD} if state.entry_mode is FlightMode.TAKEOFF else set()
    return {FlightMode.OFFBOARD, state.entry_mode} | after_takeoff


def safety(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """Act on the gravest hazard; once the landing is committed only on one that forbids commanding."""
    verdict = inputs.verdict
    if verdict is None or state.phase not in ACTIVE:
        return None
    guidance = guidance_of(state, inputs)
    if verdict.response is Response.STOP_COMMANDING:
        return go(
            state,
            Phase.IDLE,
            Reason.SAFETY,
            now_s,
            detail=verdict.detail,
            severity=Severity.CRITICAL,
            result=CommandResult.FAILED,
        )
    if guidance is not None and guidance.committed:
        return None  # half a metre over the pad, the pad is the safest place there is
    if inputs.vehicle is not None and not inputs.vehicle.armed:
        return go(
            state,
            Phase.IDLE,
            Reason.SAFETY,
            now_s,
            detail=verdict.detail,
            severity=Severity.WARNING,
            result=CommandResult.FAILED,
        )
    phase = {
        Response.LAND: Phase.FALLBACK_LAND,
        Response.RETURN: Phase.RETURN,
        Response.HOLD: Phase.HOLD,
    }.get(verdict.response)
    if phase is None:
        return fail(state, Reason.SAFETY, now_s, config, verdict.detail)
    return go(
        state,
        phase,
        Reason.SAFETY,
        now_s,
        detail=verdict.detail,
        severity=Severity.CRITICAL,
        result=CommandResult.FAILED,
    )
