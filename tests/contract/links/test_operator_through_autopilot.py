"""A phone that is reached through the Pixhawk: its messages come over the autopilot's own link, forwarded by PX4."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import aclosing
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from app.config import AutopilotConfig, OperatorConfig
from app.messages import CommandAnswer, CommandResult, OperatorAction, OperatorCommand, OperatorText, VehicleState
from drivers.autopilot.px4_mavsdk import Px4Autopilot
from drivers.operator.mavlink import MavlinkOperator

PHONE: Any = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)


def forward(autopilot: Any, message: Any) -> None:
    """PX4 passes a message of the phone's on."""
    autopilot.station.socket.sendto(message.pack(PHONE), autopilot.station.remote)


async def ordered(autopilot: Any, commands: AsyncIterator[OperatorCommand]) -> OperatorCommand:
    """Order a search as phones do: again each half second, until it is taken. What is sent before MAVSDK listens to
    commands is lost.
    """
    arrives = asyncio.ensure_future(anext(commands))
    for confirmation in range(20):
        forward(autopilot, PHONE.command_long_encode(1, 191, 31010, confirmation, 3.0, 4.0, *(math.nan,) * 5))
        done, _ = await asyncio.wait({arrives}, timeout=0.5)
        if done:
            return arrives.result()
    arrives.cancel()
    raise AssertionError("the order was not taken in 10 s")


async def test_phone_behind_the_autopilot_orders_and_is_answered_and_told(autopilot: Any, port: int) -> None:
    config = AutopilotConfig(address=f"udpin://127.0.0.1:{port}", connect_timeout_s=10.0)
    async with Px4Autopilot(config) as link, MavlinkOperator(OperatorConfig(address=""), link) as phone_link:
        forward(autopilot, PHONE.heartbeat_encode(6, 8, 0, 0, 4))
        async with aclosing(phone_link.commands()) as commands:
            order = await ordered(autopilot, commands)
        assert (order.action, order.height_m, order.sender) == (OperatorAction.SEARCH, 4.0, (255, 190))
        await phone_link.answer(CommandAnswer(order.number, CommandResult.ACCEPTED))
        await asyncio.to_thread(
            autopilot.station.wait_for, "COMMAND_ACK", lambda m: (m.result, m.target_system) == (0, 255)
        )
        await phone_link.say(OperatorText("Searching"))
        text = await asyncio.to_thread(autopilot.station.wait_for, "STATUSTEXT")
        assert text.text == "Searching"


async def test_heartbeat_of_the_phone_is_not_taken_for_the_autopilots(autopilot: Any, port: int) -> None:
    config = AutopilotConfig(address=f"udpin://127.0.0.1:{port}", connect_timeout_s=10.0)
    async with Px4Autopilot(config) as link, aclosing(link.states()) as states:
        phone = mavlink.MAVLink(None, srcSystem=1, srcComponent=190)
        for _ in range(5):
            armed = phone.heartbeat_encode(6, 8, 128, 6 << 16, 4)
            autopilot.station.socket.sendto(armed.pack(phone), autopilot.station.remote)
        seen: list[VehicleState] = [await anext(states) for _ in range(20)]
    assert {s.armed for s in seen} == {False}
