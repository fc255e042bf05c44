"""Vehicle states: from the autopilot to the queue."""

from __future__ import annotations

from app.channels import Topic
from app.errors import AutopilotError
from app.messages import VehicleState
from app.ports import Autopilot


async def run_telemetry(*, autopilot: Autopilot, vehicle: Topic[VehicleState]) -> None:
    """Publish states for as long as the link lives.

    Raises:
        AutopilotError: It ended, or failed.
    """
    async for state in autopilot.states():
        vehicle.publish(state)
    raise AutopilotError("the autopilot's telemetry ended", "see that the link is up and start again")
