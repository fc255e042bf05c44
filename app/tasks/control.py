"""The velocity controller's loop: 50 times a second, one setpoint, sent once. Nothing else sends setpoints.

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
from app.guidance.velocity import VelocityController
from app.messages import (
    ControlTurn,
    GoalKind,
    GoalOrder,
    GuidanceStatus,
    PadTrack,
    Setpoint,
    VehicleState,
)
from app.ports import Autopilot


async def run_control(
    *,
    orders: Latest[GoalOrder],
    tracks: Latest[PadTrack],
    vehicle: Latest[VehicleState],
    statuses: Topic[GuidanceStatus],
    turns: Topic[ControlTurn],
    controller: VelocityController,
    autopilot: Autopilot,
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
        autopilot: Where the setpoints go.
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
    while True:
        next_s = max(next_s + period_s, clock.now_s() - period_s)  # after a stall no burst makes up for lost turns
        await asyncio.sleep(max(0.0, next_s - clock.now_s()))
        now_s = clock.now_s()
        track = tracks.newest
        known = track if track is not None and track.fixes_accepted >= estimation.fixes_before_confident else None
        setpoint, status = _decide(orders.newest, known, vehicle.newest, controller, safety, now_s)
        if setpoint is not None:
            await autopilot.send_setpoint(setpoint)
        sent_s = clock.now_s()
        latency_s = None
        if setpoint is not None and track is not None and track.t_last_fix_s != last_fix_s:
            last_fix_s = track.t_last_fix_s
            latency_s = sent_s - last_fix_s
        if status is not None:
            statuses.publish(status)
        turns.publish(ControlTurn(sent_s, now_s - previous_s, setpoint, latency_s, status))
        previous_s = now_s
        alive()


def _decide(
    order: GoalOrder | None,
    track: PadTrack | None,
    vehicle: VehicleState | None,
    controller: VelocityController,
    safety: SafetyConfig,
    now_s: float,
) -> tuple[Setpoint | None, GuidanceStatus | None]:
    if order is None or order.goal.kind is GoalKind.NONE or vehicle is None:
        controller.forget()
        return None, None
    if not np.isfinite([*vehicle.pos_ned_m, *vehicle.vel_ned_m_s, *vehicle.q_ned_from_body_wxyz]).all():
        return None, None
    if now_s - order.t_s > safety.setpoint_gap_max_s or now_s - vehicle.t_capture_s > safety.vehicle_state_stale_s:
        return None, None
    return controller.step(order.goal, track, vehicle, now_s)
