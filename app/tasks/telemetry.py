"""Vehicle states: from the autopilot to the queue."""

from __future__ import annotations

from app.channels import Topic
from app.messages import VehicleState
from app.ports import Autopilot


async def run_telemetry(*, autopilot: Autopilot, vehicle: Topic[VehicleState]) -> None:
    """Publish states for as long as the link lives."""
    async for state in autopilot.states():
        vehicle.publish(state)
