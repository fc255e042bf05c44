"""Getting PX4 into a mode: offboard, when Alight is to steer; a mode of PX4's own, when it is not to. Pure.

What PX4 accepted shows in telemetry up to a second later. A mode that was accepted and does not show is the pilot's
doing, and is not asked for again.
"""

from __future__ import annotations

from dataclasses import replace

from app.config import MissionConfig
from app.messages import AutopilotAction, CommandResult, FlightMode, Phase, Severity, VehicleState
from app.mission.states import OWN_MODE, MissionState, Reason, Transition
from app.mission.transitions import CONFIRM_S, ask, fail, go

STREAM_BEFORE_OFFBOARD_S = 0.5
"""PX4 wants setpoints at 2 Hz or more before it enters offboard."""
REFUSALS_MAX = 3


def enter_offboard(state: MissionState, vehicle: VehicleState, now_s: float, config: MissionConfig) -> Transition:
    """Stream, ask for offboard, and wait until PX4 has accepted it and shows it."""
    if state.accepted is AutopilotAction.OFFBOARD:
        if vehicle.mode is FlightMode.OFFBOARD:
            return Transition(replace(state, offboard_seen=True))
        if now_s - state.asked_s < CONFIRM_S:
            return Transition(state)
        # PX4 did enter it, and somebody left it before telemetry showed it: asking again would fight the pilot.
        return go(
            state,
            Phase.IDLE,
            Reason.PILOT_TOOK_OVER,
            now_s,
            detail=f"{vehicle.mode.value} mode by pilot or PX4, hands off",
            severity=Severity.WARNING,
            result=CommandResult.CANCELLED,
        )
    if state.refusals >= REFUSALS_MAX:
        return fail(state, Reason.REFUSED_BY_AUTOPILOT, now_s, config, "PX4 refused offboard")
    if now_s - state.since_s < STREAM_BEFORE_OFFBOARD_S:
        return Transition(state)
    return ask(state, AutopilotAction.OFFBOARD, now_s)


def hand_over(state: MissionState, vehicle: VehicleState, now_s: float) -> Transition:
    """Ask PX4 for a mode of its own until it has taken it up or refused it too often; from then on it flies.

    It is asked for even if it shows already: an earlier request for another mode may still be on its way.
    """
    if state.handed_over:
        return Transition(state)
    action, mode = OWN_MODE[state.phase]
    answered = state.asked is action and state.pending is None
    if answered and vehicle.mode is mode:
        return Transition(replace(state, handed_over=True))
    # Accepted, and another mode shows after all: the pilot's. In offboard nobody steers, so ask again.
    taken = state.accepted is action and now_s - state.asked_s >= CONFIRM_S
    if state.refusals >= REFUSALS_MAX or (taken and vehicle.mode not in (FlightMode.OFFBOARD, FlightMode.UNKNOWN)):
        detail = f"PX4 does not {action.value}, it is in {vehicle.mode.value}"
        return go(state, Phase.IDLE, Reason.REFUSED_BY_AUTOPILOT, now_s, detail=detail, severity=Severity.CRITICAL)
    return ask(state, action, now_s)
