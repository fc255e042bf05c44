"""What comes before any phase: answers to actions, the end of the flight, the pilot, safety. Pure."""

from __future__ import annotations

from dataclasses import replace

from app.config import MissionConfig
from app.messages import (
    AutopilotAction,
    CommandResult,
    FlightMode,
    GuidanceStatus,
    LandedState,
    Phase,
    Response,
    Severity,
    VehicleState,
    Verdict,
)
from app.mission.endings import suspend, watch
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
from app.mission.transitions import CONFIRM_S, enter_disarm, fail, go, guidance_of, leave, stands

ANSWER_MAX_S = 40.0
"""Beyond the longest time limit of an action: an answer that has not come by then never will."""
RESTED_S = 3.0
"""A vehicle that rested on the pad so lately is still on it: PX4 takes 2 s from its own detection to the disarm."""
TAKEOFF_ENDS_BELOW_M = 1.0
"""PX4 ends its take-off up to 0.8 m under the height that was asked for (NAV_MC_ALT_RAD)."""
FINISH_BELOW_M = 0.28
"""With the vehicle's centre lower than this over the pad, stopping the sink takes longer than touching down."""


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
            refusal="" if result.ok else result.detail,
            refusals=state.refusals if result.ok else state.refusals + 1,
            takeoff_accepted=state.takeoff_accepted or taken_off,
            takeoff_accepted_s=now_s if taken_off else state.takeoff_accepted_s,
        )
    if state.pending is not None and now_s - state.asked_s > ANSWER_MAX_S:
        state = replace(state, pending=None, refusals=state.refusals + 1)
    return state


def end_of_flight(state: MissionState, inputs: MissionInputs, now_s: float) -> Transition | None:
    """Disarmed while flying: on the pad that is the aim, anywhere else the end of the mission."""
    vehicle = inputs.vehicle
    if vehicle is None or vehicle.armed or state.phase not in IN_OFFBOARD | HANDED_OVER | {Phase.SUSPENDED}:
        return None
    if state.phase in (Phase.LAND, Phase.PRECLAND) and _on_pad(state, inputs, vehicle, now_s):
        return go(state, Phase.LANDED, Reason.TOUCHDOWN, now_s, severity=Severity.NOTICE, result=CommandResult.ACCEPTED)
    guidance = guidance_of(state, inputs)
    height_m = None if guidance is None else guidance.height_above_pad_m
    in_air = state.phase in IN_OFFBOARD and height_m is not None
    detail = f"motors stopped {height_m:.1f} m over the pad" if in_air else ""
    severity = Severity.CRITICAL if in_air else Severity.NOTICE
    return go(state, Phase.IDLE, Reason.DISARMED, now_s, detail=detail, severity=severity, result=CommandResult.FAILED)


def _on_pad(state: MissionState, inputs: MissionInputs, vehicle: VehicleState, now_s: float) -> bool:
    """Whether a vehicle that was just disarmed had come down onto the pad: committed, and it rested on something."""
    guidance = guidance_of(state, inputs)
    if guidance is None or not guidance.committed:
        return False
    felt = guidance.contact or (state.contact_s is not None and now_s - state.contact_s < RESTED_S)
    return felt or vehicle.landed is LandedState.ON_GROUND


def pilot(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """Hands off, the moment PX4 is in a mode that Alight did not ask for."""
    vehicle = inputs.vehicle
    if vehicle is None or not vehicle.armed or state.phase not in ACTIVE | HANDED_OVER:
        return None
    mode = vehicle.mode
    if mode is FlightMode.UNKNOWN or mode in _ours(state, vehicle, now_s, config) or _disarms(state, vehicle):
        return None
    if state.phase is Phase.TAKEOFF and stands(vehicle) and mode is state.entry_mode:
        # PX4 accepted the take-off and does nothing: the motors that this order started are stopped again.
        return enter_disarm(state, Reason.REFUSED_BY_AUTOPILOT, now_s, detail="PX4 does not take off")
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
    """On the ground PX4 leaves a mode of its own for another one as it disarms, and the disarm shows up to a second
    later. Nothing is commanded meanwhile.
    """
    if not state.handed_over or not stands(vehicle):
        return False
    if state.phase is Phase.PRECLAND:
        return state.committed_since_s is not None and vehicle.mode is FlightMode.OFFBOARD
    return state.phase in HANDED_OVER


def _ours(state: MissionState, vehicle: VehicleState, now_s: float, config: MissionConfig) -> set[FlightMode]:
    """The modes that are no sign of the pilot: the one asked for, and until that shows, the one before it."""
    if state.phase is Phase.TAKEOFF:
        own = {FlightMode.TAKEOFF}
        if near_takeoff_height(state, vehicle, config):
            own.add(FlightMode.HOLD)  # PX4's take-off ends in hold
        waits = not state.takeoff_accepted or now_s - state.takeoff_accepted_s < CONFIRM_S
        return own | {state.entry_mode} if waits and not state.takeoff_seen else own
    if state.phase in HANDED_OVER:
        _, mode = OWN_MODE[state.phase]
        if state.handed_over:
            return {mode}
        return {mode, state.entry_mode, FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD}
    if state.offboard_seen:
        return {FlightMode.OFFBOARD}
    after_takeoff = {FlightMode.HOLD} if state.entry_mode is FlightMode.TAKEOFF else set()
    return {FlightMode.OFFBOARD, state.entry_mode} | after_takeoff


def near_takeoff_height(state: MissionState, vehicle: VehicleState, config: MissionConfig) -> bool:
    """Whether the climb is so far that PX4 may have ended its take-off: it does within NAV_MC_ALT_RAD, 0.8 m."""
    ground_down = 0.0 if state.home_ned_m is None else float(state.home_ned_m[2])
    return ground_down - float(vehicle.pos_ned_m[2]) >= config.search_height_m - TAKEOFF_ENDS_BELOW_M


def safety(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """Act on the gravest hazard; once the landing is committed only on one that forbids to command or to trust."""
    verdict, vehicle = inputs.verdict, inputs.vehicle
    if verdict is None or state.phase not in ACTIVE:
        return watch(state, inputs, now_s, config)
    if verdict.response is Response.STOP_COMMANDING:
        return suspend(state, inputs, verdict, now_s)
    guidance = guidance_of(state, inputs)
    if guidance is not None and guidance.committed and not _gives_up(guidance, verdict):
        return None  # half a metre over the pad, the pad is the safest place there is
    if vehicle is not None and ((vehicle.armed and stands(vehicle)) or (not vehicle.armed and state.arm_asked)):
        return enter_disarm(state, Reason.SAFETY, now_s, detail=verdict.detail)
    if vehicle is not None and not vehicle.armed:
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
    return leave(state, phase, Reason.SAFETY, now_s, config, verdict.detail, Severity.CRITICAL)


def _gives_up(guidance: GuidanceStatus, verdict: Verdict) -> bool:
    """Whether a committed landing is broken off: what is seen can't be believed, and it is high enough to stop."""
    height_m = guidance.height_above_pad_m
    high = height_m is not None and height_m > FINISH_BELOW_M
    return verdict.response is Response.HOLD and not guidance.contact and high
