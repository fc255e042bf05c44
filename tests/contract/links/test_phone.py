"""The terminal's ground station: against the link that it talks to in flight, and against one that answers late."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing
from typing import Any

import pytest

from app.config import OperatorConfig
from app.errors import OperatorError
from app.messages import CommandAnswer, CommandResult, OperatorAction, OperatorCommand, OperatorText, Severity
from drivers.operator.mavlink import MavlinkOperator
from drivers.operator.phone import PhoneEvent, PhoneProgress, PhoneResult, PhoneText, Wanted, send_command


@pytest.fixture
async def link(port: int) -> AsyncIterator[MavlinkOperator]:
    async with MavlinkOperator(OperatorConfig(address=f"udpin://127.0.0.1:{port}")) as link:
        yield link


async def next_command(link: MavlinkOperator) -> OperatorCommand:
    async with aclosing(link.commands()) as commands:
        return await anext(commands)


async def test_phone_order_carried_out_tells_progress_lines_and_result(link: MavlinkOperator, port: int) -> None:
    def order() -> list[PhoneEvent]:
        return list(
            send_command(f"udpin://127.0.0.1:{port}", Wanted(OperatorAction.TRACK, 2.5, 3.75, 90.0), linger_s=0.1)
        )

    phone = asyncio.create_task(asyncio.to_thread(order))
    command = await next_command(link)
    assert (command.action, command.height_m) == (OperatorAction.TRACK, 2.5)
    assert command.pad_drives_ne_m_s == pytest.approx((0.0, 3.75), abs=1e-6)
    await link.say(OperatorText("Searching", Severity.NOTICE))
    await link.answer(CommandAnswer(command.number, CommandResult.IN_PROGRESS, 30))
    await link.answer(CommandAnswer(command.number, CommandResult.ACCEPTED))
    events = await phone
    assert events[0] == PhoneProgress(0)
    assert PhoneProgress(30) in events
    assert PhoneText("Searching", 5) in events
    assert events[-1] == PhoneResult(CommandResult.ACCEPTED)


async def test_phone_order_without_height_leaves_it_to_the_configuration(link: MavlinkOperator, port: int) -> None:
    def order() -> list[PhoneEvent]:
        return list(send_command(f"udpout://127.0.0.1:{port}", Wanted(OperatorAction.LAND), linger_s=0.0))

    phone = asyncio.create_task(asyncio.to_thread(order))
    command = await next_command(link)
    await link.answer(CommandAnswer(command.number, CommandResult.TEMPORARILY_REJECTED))
    assert command.height_m is None
    assert (await phone)[-1] == PhoneResult(CommandResult.TEMPORARILY_REJECTED)


def test_phone_with_nobody_at_the_address_says_so_and_what_to_do(port: int) -> None:
    address = f"udpin://127.0.0.1:{port}"
    with pytest.raises(OperatorError, match=f"{address}: nobody answers within 0.3 s; start alight run"):
        list(send_command(address, Wanted(OperatorAction.LAND), timeout_s=0.3))


@pytest.mark.parametrize("address", ["serial:///dev/ttyUSB0:57600", "udpin://127.0.0.1", "udpin://127.0.0.1:99999"])
def test_phone_address_that_is_no_udp_address_is_refused(address: str) -> None:
    with pytest.raises(OperatorError, match="not a UDP address"):
        list(send_command(address, Wanted(OperatorAction.LAND)))


def test_phone_order_unanswered_is_sent_again_with_its_confirmation_counted_up(
    make_alight: Callable[..., Any], port: int
) -> None:
    alight = make_alight(None, 0)
    events = list(send_command(f"udpin://127.0.0.1:{port}", Wanted(OperatorAction.SEARCH), linger_s=0.0))
    orders = [m for _, m in alight.of_kind("COMMAND_LONG")]
    assert events == [PhoneResult(CommandResult.ACCEPTED)]
    assert [m.confirmation for m in orders] == [0, 1]
    assert {(m.target_system, m.target_component, m.command, m.param1) for m in orders} == {(7, 191, 31010, 3.0)}
    assert all(math.isnan(m.param2) for m in orders)


def test_phone_that_is_heard_and_never_answered_says_that_alight_is_there(
    make_alight: Callable[..., Any], port: int
) -> None:
    make_alight()
    with pytest.raises(OperatorError, match="Alight is there and did not answer"):
        list(send_command(f"udpin://127.0.0.1:{port}", Wanted(OperatorAction.LAND), timeout_s=0.3))


def test_phone_whose_answers_cease_says_so(make_alight: Callable[..., Any], port: int) -> None:
    make_alight(5)
    with pytest.raises(OperatorError, match="answers ceased"):
        list(send_command(f"udpin://127.0.0.1:{port}", Wanted(OperatorAction.LAND), timeout_s=0.3))
