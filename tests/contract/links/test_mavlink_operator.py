"""The link to the phone, against a ground station that shares no code with it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing
from typing import Any

import pytest

from app.config import OperatorConfig
from app.errors import OperatorError
from app.messages import CommandAnswer, CommandResult, OperatorAction, OperatorCommand, OperatorText, Severity
from app.ports import OperatorLink
from drivers.operator.mavlink import MavlinkOperator

LAND, TRACK, HOLD = (float(OperatorAction[name]) for name in ("LAND", "TRACK", "HOLD"))


@pytest.fixture
async def link(port: int) -> AsyncIterator[OperatorLink]:
    async with MavlinkOperator(OperatorConfig(address=f"udpin://127.0.0.1:{port}")) as link:
        yield link


async def next_command(link: OperatorLink, timeout_s: float = 5.0) -> OperatorCommand:
    async with asyncio.timeout(timeout_s):
        async with aclosing(link.commands()) as commands:
            return await anext(commands)


async def wait(call: Callable[..., Any], *args: Any, **named: Any) -> Any:
    """A blocking wait of the ground station, off the loop."""
    return await asyncio.to_thread(call, *args, **named)


async def found(ground_station: Any) -> None:
    """Until the ground station has heard component 191, and so is known to it."""
    await wait(ground_station.wait_for, "HEARTBEAT", lambda m: m.get_srcComponent() == 191)


async def test_operator_open_shows_phones_a_heartbeat_of_component_191(link: OperatorLink, ground_station: Any) -> None:
    beat = await wait(ground_station.wait_for, "HEARTBEAT", lambda m: m.get_srcComponent() == 191)
    assert beat.get_srcSystem() == 1


async def test_operator_order_reaches_the_application_with_action_height_and_sender(
    link: OperatorLink, ground_station: Any
) -> None:
    before_s = time.monotonic()
    ground_station.command(31010, TRACK, 2.5)
    command = await next_command(link)
    assert (command.action, command.height_m, command.sender) == (OperatorAction.TRACK, 2.5, (255, 190))
    assert before_s <= command.t_s <= time.monotonic()


async def test_operator_order_as_a_command_int_is_the_same_order(link: OperatorLink, ground_station: Any) -> None:
    fields = (1, 191, 0, 31010, 0, 0, TRACK, 2.5, float("nan"), float("nan"), 0, 0, float("nan"))
    ground_station.send(ground_station.mav.command_int_encode(*fields))
    command = await next_command(link)
    assert (command.action, command.height_m) == (OperatorAction.TRACK, 2.5)
    await wait(ground_station.wait_for_ack, 5)


async def test_operator_order_pending_is_answered_in_progress_again_until_the_outcome(
    link: OperatorLink, ground_station: Any
) -> None:
    ground_station.command(31010, LAND)
    command = await next_command(link)
    first = await wait(ground_station.wait_for_ack, 5)
    await link.answer(CommandAnswer(command.number, CommandResult.IN_PROGRESS, 40))
    told = await wait(ground_station.wait_for, "COMMAND_ACK", lambda m: m.progress == 40)
    again = await wait(ground_station.wait_for, "COMMAND_ACK", lambda m: m.progress == 40, timeout_s=1.0)
    await link.answer(CommandAnswer(command.number, CommandResult.ACCEPTED))
    last = await wait(ground_station.wait_for_ack, 0)
    assert [m.target_system for m in (first, told, again, last)] == [255] * 4
    assert [m.target_component for m in (first, told, again, last)] == [190] * 4


async def test_operator_order_retransmitted_is_given_once_and_answered_again(
    link: OperatorLink, ground_station: Any
) -> None:
    ground_station.command(31010, LAND)
    command = await next_command(link)
    await link.answer(CommandAnswer(command.number, CommandResult.DENIED))
    await wait(ground_station.wait_for_ack, 2)
    ground_station.command(31010, LAND, confirmation=1)
    await wait(ground_station.wait_for_ack, 2)
    ground_station.command(31010, HOLD)
    following = await next_command(link)
    assert following.action is OperatorAction.HOLD
    assert following.number == command.number + 1


async def test_operator_order_replaced_by_another_is_no_longer_answered(
    link: OperatorLink, ground_station: Any
) -> None:
    ground_station.command(31010, LAND)
    land = await next_command(link)
    ground_station.command(31010, HOLD)
    hold = await next_command(link)
    await link.answer(CommandAnswer(land.number, CommandResult.FAILED))
    await link.answer(CommandAnswer(hold.number, CommandResult.ACCEPTED))
    await wait(ground_station.wait_for_ack, 0)
    assert 4 not in ground_station.acks()


@pytest.mark.parametrize(("action", "height_m"), [(0.0, 0.0), (6.0, 0.0), (1.5, 0.0), (2.0, 80.0), (2.0, -1.0)])
async def test_operator_order_with_a_wrong_parameter_is_denied_and_explained(
    link: OperatorLink, ground_station: Any, action: float, height_m: float
) -> None:
    ground_station.command(31010, action, height_m)
    await wait(ground_station.wait_for_ack, 2)
    text = await wait(ground_station.wait_for, "STATUSTEXT")
    assert text.severity == 4


async def test_operator_unknown_command_is_answered_unsupported_once(link: OperatorLink, ground_station: Any) -> None:
    ground_station.command(31011, 1.0)
    await wait(ground_station.wait_for_ack, 3, command=31011)
    ground_station.command(31010, 99.0)
    await wait(ground_station.wait_for_ack, 2)
    assert ground_station.acks(31011) == [3]


@pytest.mark.parametrize(("system", "component"), [(1, 0), (0, 0), (1, 1), (2, 191)])
async def test_operator_order_not_addressed_to_us_is_ignored(
    link: OperatorLink, ground_station: Any, system: int, component: int
) -> None:
    ground_station.command(31010, LAND, system=system, component=component)
    ground_station.command(31010, HOLD)
    command = await next_command(link)
    assert command.action is OperatorAction.HOLD
    await wait(ground_station.wait_for_ack, 5)


async def test_operator_cancel_gives_a_hold_and_ends_as_cancelled(link: OperatorLink, ground_station: Any) -> None:
    ground_station.command(31010, LAND)
    await next_command(link)
    ground_station.cancel(31010)
    hold = await next_command(link)
    assert hold.action is OperatorAction.HOLD
    await link.answer(CommandAnswer(hold.number, CommandResult.ACCEPTED))
    await wait(ground_station.wait_for_ack, 6)


async def test_operator_orders_of_two_phones_are_answered_each(
    link: OperatorLink, make_ground_station: Callable[..., Any]
) -> None:
    first, second = make_ground_station(system_id=255), make_ground_station(system_id=254)
    first.command(31010, LAND)
    land = await next_command(link)
    second.command(31010, HOLD)
    hold = await next_command(link)
    await link.answer(CommandAnswer(hold.number, CommandResult.ACCEPTED))
    await link.answer(CommandAnswer(land.number, CommandResult.CANCELLED))
    ack = await wait(second.wait_for, "COMMAND_ACK", lambda m: m.result == 0 and m.target_system == 254)
    cancelled = await wait(first.wait_for, "COMMAND_ACK", lambda m: m.result == 6 and m.target_system == 255)
    assert (ack.command, cancelled.command) == (31010, 31010)


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("Landed", "Landed"),
        ("x" * 51, "x" * 47 + "..."),
        ("Höhe 2\nm", "H?he 2 m"),
    ],
)
async def test_operator_text_is_shown_in_fifty_ascii_characters(
    link: OperatorLink, ground_station: Any, said: str, shown: str
) -> None:
    await found(ground_station)
    await link.say(OperatorText(said, Severity.NOTICE))
    text = await wait(ground_station.wait_for, "STATUSTEXT")
    assert (text.text, text.severity, text.get_srcComponent()) == (shown, 5, 191)


async def test_operator_text_without_a_phone_is_no_error(link: OperatorLink) -> None:
    await link.say(OperatorText("nobody hears this"))


async def test_operator_address_in_use_is_an_error_that_names_it(link: OperatorLink, port: int) -> None:
    address = f"udpin://127.0.0.1:{port}"
    with pytest.raises(OperatorError, match=f"{address}: another program holds port {port}"):
        async with MavlinkOperator(OperatorConfig(address=address)):
            pass


def test_operator_without_address_and_autopilot_is_refused() -> None:
    with pytest.raises(OperatorError, match="give an address"):
        MavlinkOperator(OperatorConfig(address=""))
