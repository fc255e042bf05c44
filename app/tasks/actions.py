"""Actions of the autopilot: each request runs to its answer, beside the loops, so none of them ever waits.

The mission owns one action at a time: a new request ends the one that runs.
"""

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
        action: Which; None only cancels the one that runs.
        height_m: For TAKEOFF.
        asked_s: When the mission decided it; None: now.
    """

    action: AutopilotAction | None
    height_m: float = 0.0
    asked_s: float | None = None


async def run_actions(*, requests: Events[ActionRequest], results: Events[ActionResult], autopilot: Autopilot) -> None:
    """Run each request as it comes. A new one cancels the one that runs, which then gives no result and is not sent
    again.
    """
    async with asyncio.TaskGroup() as group:
        running: asyncio.Task[None] | None = None
        while True:
            request = await requests.get()
            if running is not None:
                running.cancel()
            running = None
            if request.action is not None:
                running = group.create_task(_execute(request.action, request, results, autopilot))


async def _execute(
    action: AutopilotAction, request: ActionRequest, results: Events[ActionResult], autopilot: Autopilot
) -> None:
    try:
        await autopilot.execute(action, height_m=request.height_m, asked_s=request.asked_s)
    except AutopilotError as error:
        log.warning("action.refused", action=action.value, detail=error.what)
        results.emit(ActionResult(action, ok=False, detail=error.what))
    else:
        log.info("action.accepted", action=action.value)
        results.emit(ActionResult(action, ok=True))
