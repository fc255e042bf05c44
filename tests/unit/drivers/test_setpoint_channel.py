"""Setpoints that are old, or come while another is on its way, never leave."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator

import pytest

from drivers.autopilot.setpoint_channel import SetpointChannel


@pytest.fixture
async def channel() -> AsyncIterator[SetpointChannel]:
    channel = SetpointChannel()
    yield channel
    await channel.close()


async def test_setpoint_fresh_is_put_once(channel: SetpointChannel) -> None:
    put: list[str] = []
    await channel.send(lambda: put.append("a") or "", time.monotonic())  # type: ignore[func-returns-value]  # append returns None
    assert put == ["a"]
    assert (channel.sent, channel.dropped) == (1, 0)


async def test_setpoint_old_is_not_put(channel: SetpointChannel) -> None:
    put: list[str] = []
    await channel.send(lambda: put.append("a") or "", time.monotonic() - 0.21)  # type: ignore[func-returns-value]  # append returns None
    assert put == []
    assert (channel.sent, channel.dropped) == (0, 1)


async def test_setpoint_behind_one_that_blocks_is_dropped_and_the_caller_is_not_held(channel: SetpointChannel) -> None:
    free = threading.Event()

    def block() -> str:
        free.wait(5.0)
        return ""

    start_s = time.monotonic()
    await channel.send(block, start_s)
    assert time.monotonic() - start_s < 1.0
    put: list[str] = []
    await channel.send(lambda: put.append("b") or "", time.monotonic())  # type: ignore[func-returns-value]  # append returns None
    free.set()
    async with asyncio.timeout(5.0):
        while not put:  # until the thread is free again
            await channel.send(lambda: put.append("c") or "", time.monotonic())  # type: ignore[func-returns-value]  # append returns None
            await asyncio.sleep(0)
    assert put == ["c"]


async def test_setpoint_that_the_link_refuses_is_no_error_and_not_counted_as_sent(channel: SetpointChannel) -> None:
    await channel.send(lambda: "CONNECTION_ERROR", time.monotonic())
    assert channel.sent == 0


async def test_channel_closes_only_when_what_is_being_sent_has_left() -> None:
    channel, leave, left = SetpointChannel(), threading.Event(), []

    def put() -> str:
        leave.wait(5.0)
        left.append("a")
        return ""

    sending = asyncio.create_task(channel.send(put, time.monotonic()))
    await asyncio.sleep(0.05)
    closing = asyncio.create_task(channel.close())
    await asyncio.sleep(0.05)
    assert not closing.done()
    leave.set()
    await closing
    assert left == ["a"]
    await sending
