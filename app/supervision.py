"""What is done when a part fails or the application ends: parts started again, the vehicle held, the phone answered."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable

from app.channels import Topic
from app.clock import LoopClock
from app.errors import AlightError, AutopilotError
from app.log import get_logger
from app.messages import (
    AutopilotAction,
    CommandAnswer,
    FlightMode,
    MissionReport,
    OperatorText,
    Phase,
    Severity,
    VehicleState,
)
from app.mission.states import ACTIVE, HANDED_OVER
from app.mission.transitions import stands
from app.ports import Autopilot, OperatorLink

log = get_logger("supervision")

RESTARTS_MAX = 5
GOOD_RUN_S = 300.0
"""A part that ran for so long is well again: its restarts are counted anew, and one hiccup a day ends nothing."""
RESTART_AFTER_S = 1.0
PILOTS_MODES = frozenset({FlightMode.MANUAL, FlightMode.ALTITUDE, FlightMode.POSITION})
"""Whoever flies in one of these has the sticks in hand: an application that ends takes nothing from them."""
LAST_WORDS_S = 1.0
"""For the phone's last answers, once every task has ended."""


async def supervise(
    name: str,
    run: Callable[[], Awaitable[None]],
    *,
    proven: Callable[[], bool],
    texts: Topic[OperatorText],
    vital: bool = True,
) -> None:
    """Run a part that may fail: start it again a bounded number of times without a good run in between, then let its
    last error end all, or if it isn't vital, go on without it.

    Args:
        name: Of the part, for log and phone.
        run: Starts it.
        proven: Whether all of it has worked at least once: before that it was never right, and its error ends all.
        texts: To the phone.
        vital: Whether a flight needs it.
    """
    clock, restarts = LoopClock(), 0
    while True:
        started_s = clock.now_s()
        try:
            await run()
            return
        except Exception as error:
            if clock.now_s() - started_s >= GOOD_RUN_S:
                restarts = 0
            if not proven() or (restarts == RESTARTS_MAX and vital):
                raise
            if restarts == RESTARTS_MAX:
                log.error("part.given_up", part=name, error=str(error))
                texts.publish(OperatorText(f"{name} failed for good", Severity.ERROR))
                return
            restarts += 1
            log.error("part.restarted", part=name, attempt=restarts, error=str(error))
            texts.publish(OperatorText(f"{name} failed, restart {restarts}", Severity.ERROR))
            await asyncio.sleep(RESTART_AFTER_S)


async def hold_vehicle(
    autopilot: Autopilot, report: MissionReport | None, vehicle: VehicleState | None, timeout_s: float
) -> None:
    """Leave the vehicle in a mode of PX4's own, if Alight was steering it, or has let go and PX4 has not taken over.

    This is for an end without the mission: a part of the application has failed. On the deck the motors are stopped:
    by force if that was proven to be right just now, else by PX4's own landing. Low over a pad at rest PX4 lands, over
    one that drives it returns, which begins with a climb. Anywhere else it holds.

    Args:
        autopilot: The link.
        report: The mission's last.
        vehicle: Its last state.
        timeout_s: For PX4's answer to each request.
    """
    if report is None or report.phase not in ACTIVE | HANDED_OVER | {Phase.SUSPENDED, Phase.DISARM}:
        return
    if report.phase in HANDED_OVER - ACTIVE and (vehicle is None or vehicle.mode is not FlightMode.OFFBOARD):
        return
    if vehicle is not None and vehicle.mode in PILOTS_MODES:
        return
    for action in _last_actions(report, vehicle):
        try:
            async with asyncio.timeout(timeout_s):
                await autopilot.execute(action)
        except (AutopilotError, TimeoutError) as error:
            log.error("vehicle.not_left", action=action.value, error=str(error))
        else:
            log.warning("vehicle.left", action=action.value, phase=report.phase.value)
            return


def _last_actions(report: MissionReport, vehicle: VehicleState | None) -> tuple[AutopilotAction, ...]:
    """What is asked for, one after the other until one is accepted."""
    if report.phase is Phase.DISARM or (vehicle is not None and vehicle.armed and stands(vehicle)):
        return AutopilotAction.DISARM, AutopilotAction.LAND
    if report.contact:
        by_force = (AutopilotAction.FORCE_DISARM,) if report.may_force_disarm else ()
        return *by_force, AutopilotAction.LAND, AutopilotAction.HOLD
    if report.committed:
        first = AutopilotAction.RETURN if report.pad_drives else AutopilotAction.LAND
        return first, AutopilotAction.HOLD
    return (AutopilotAction.HOLD,)


async def answer_last(operator: OperatorLink, answers: Iterable[CommandAnswer]) -> None:
    """Give the phone the answers that are still owed to it."""
    try:
        async with asyncio.timeout(LAST_WORDS_S):
            for answer in answers:
                await operator.answer(answer)
    except (AlightError, TimeoutError) as error:
        log.warning("answers.lost", error=str(error))


def first_error(group: BaseExceptionGroup[BaseException]) -> BaseException:
    """The first error of a group, however nested."""
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error
