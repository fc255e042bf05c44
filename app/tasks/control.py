"""The velocity controller's loop: 50 times a second, one setpoint, sent once. Nothing else sends setpoints, and none
leaves the envelope. While PX4 lands by its own precision landing, it is told where the pad is instead, 20 times a
second.

No setpoint outlives its sender: the link re-sends nothing, so a loop that stops is a stream that stops, and PX4's own
offboard-loss failsafe takes over. The loop itself falls silent when the mission's order or the vehicle's state is old.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import numpy as np

from app.channels import Latest, Topic
from app.clock import Clock
from app.config import EstimationConfig, SafetyConfig
from app.frames import is_rotation
from app.guidance.envelope import Envelope, Surroundings, bounded
from app.guidance.precland import PrecisionLanding
from app.guidance.velocity import VelocityController
from app.messages import (
    ControlTurn,
    FlightMode,
    GoalKind,
    GoalOrder,
    GuidanceStatus,
    LandingTarget,
    PadTrack,
    Setpoint,
    VehicleState,
)
from app.ports import Autopilot

TARGET_PERIOD_S = 0.05
"""PX4 looks for a target ten times a second and more, and takes one that is 0.5 s old near the ground for lost."""


async def run_control(
    *,
    orders: Latest[GoalOrder],
    tracks: Latest[PadTrack],
    vehicle: Latest[VehicleState],
    statuses: Topic[GuidanceStatus],
    turns: Topic[ControlTurn],
    controller: VelocityController,
    precland: PrecisionLanding,
    autopilot: Autopilot,
    envelope: Envelope,
    safety: SafetyConfig,
    estimation: EstimationConfig,
    rate_hz: float,
    clock: Clock,
    alive: Callable[[], None],
) -> None:
    """Run until cancelled.

    Args:
        orders: What the mission wants.
        tracks: The pad.
        vehicle: The vehicle.
        statuses: What the controller tells the mission.
        turns: Each turn, for the record.
        controller: Guidance.
        precland: Guidance of PX4's own precision landing.
        autopilot: Where the setpoints go.
        envelope: What every setpoint keeps to, whatever made it.
        safety: Ages at which orders and states are too old.
        estimation: How many fixes make a track that may be followed: one that just began anew may be an error.
        rate_hz: Turns a second.
        clock: The time.
        alive: Called at every turn: feeds the watchdog.
    """
    period_s = 1.0 / rate_hz
    next_s = clock.now_s()
    previous_s = next_s
    last_fix_s: float | None = None
    target_due_s = next_s
    while True:
        next_s = max(next_s + period_s, clock.now_s() - period_s)  # after a stall no burst makes up for lost turns
        await asyncio.sleep(max(0.0, next_s - clock.now_s()))
        now_s = clock.now_s()
        track = tracks.newest
        known = track if track is not None and track.fixes_accepted >= estimation.fixes_before_confident else None
        order, state = orders.newest, vehicle.newest
        wanted, target, status = _decide(order, known, state, controller, precland, safety, now_s)
        setpoint = None if wanted is None else bounded(wanted, envelope, _surroundings(order, state, status))
        if setpoint is not None:
            await autopilot.send_setpoint(setpoint)
        if target is not None and now_s < target_due_s - 0.5 * period_s:
            target = None
        if target is not None:
            target_due_s = max(target_due_s + TARGET_PERIOD_S, now_s)
            await autopilot.send_landing_target(target)
        sent_s = clock.now_s()
        latency_s = None
        if setpoint is not None and track is not None and track.t_last_fix_s != last_fix_s:
            last_fix_s = track.t_last_fix_s
            latency_s = sent_s - last_fix_s
        if status is not None:
            statuses.publish(status)
        turns.publish(ControlTurn(sent_s, now_s - previous_s, setpoint, latency_s, status, target))
        previous_s = now_s
        alive()


def _surroundings(order: GoalOrder | None, vehicle: VehicleState | None, status: GuidanceStatus | None) -> Surroundings:
    """Where the vehicle is, as far as home and the track tell."""
    home = None if order is None else order.home_ned_m
    over_home_m = None if home is None or vehicle is None else float(home[2] - vehicle.pos_ned_m[2])
    if status is None:
        return Surroundings(over_home_m)
    return Surroundings(over_home_m, status.height_above_pad_m, status.committed and status.contact)


def _decide(
    order: GoalOrder | None,
    track: PadTrack | None,
    vehicle: VehicleState | None,
    controller: VelocityController,
    precland: PrecisionLanding,
    safety: SafetyConfig,
    now_s: float,
) -> tuple[Setpoint | None, LandingTarget | None, GuidanceStatus | None]:
    if order is None or order.goal.kind is GoalKind.NONE or vehicle is None:
        controller.forget()
        precland.forget()
        return None, None, None
    known = np.isfinite([*vehicle.pos_ned_m, *vehicle.vel_ned_m_s]).all()
    if not known or not is_rotation(vehicle.q_ned_from_body_wxyz):
        return None, None, None
    fresh = now_s - order.t_s <= safety.setpoint_gap_max_s
    if not (fresh and now_s - vehicle.t_capture_s <= safety.vehicle_state_stale_s):  # so put, NaN is old
        return None, None, None
    if order.goal.kind is not GoalKind.PRECLAND:
        precland.forget()
        setpoint, status = controller.step(order.goal, track, vehicle, now_s)
        return setpoint, None, status
    target, status = precland.step(order.goal, track, vehicle, now_s)
    if precland.taken_over or vehicle.mode is not FlightMode.OFFBOARD:
        controller.forget()
        return None, target, status
    setpoint, _ = controller.step(order.goal, track, vehicle, now_s)
    return setpoint, target, status
