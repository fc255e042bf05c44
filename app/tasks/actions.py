"""Actions of the autopilot: each request runs to its answer, beside the loops, so none of them ever waits."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from app.channels import Events
from app.errors import AutopilotError
from app.log import get_logger
from app.messages import ActionResult, AutopilotAction
from app.ports import Autopilot

log = get_logger("actions")


@dataclass(frozen=True, slots=True)
class ActionRequest:
    """An action that the mission asks for.

    Attributes:
        action: Which.
        height_m: For TAKEOFF.
    """

    action: AutopilotAction
    height_m: float = 0.0


async def run_actions(*, requests: Events[ActionRequest], results: Events[ActionResult], autopilot: Autopilot) -> None:
    """Run each request as it comes; a new one does not wait for an old one to be answered."""
    async with asyncio.TaskGroup() as group:
        while True:
            request = await requests.get()
            group.create_task(_execute(request, results, autopilot))


async def _execute(request: ActionRequest, results: Events[ActionResult], autopilot: Autopilot) -> None:
    try:
        await autopilot.execute(request.action, height_m=request.height_m)
    except AutopilotError as error:
        log.warning("action.refused", action=request.action.value, detail=error.what)
        results.emit(ActionResult(request.action, ok=False, detail=error.what))
    else:
        log.info("action.accepted", action=request.action.value)
        results.emit(ActionResult(request.action, ok=True))
