"""The link to PX4 against a real PX4 SITL, fresh on the ground."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing
from typing import Any

import numpy as np
import pytest

from app.config import AutopilotConfig
from app.errors import AutopilotError
from app.messages import AutopilotAction, FlightMode, LandedState, Setpoint, VehicleState
from drivers.autopilot.px4_mavsdk import Px4Autopilot

pytestmark = pytest.mark.sitl


@pytest.fixture
async def px4(sitl: Any) -> AsyncIterator[Px4Autopilot]:
    async with Px4Autopilot(AutopilotConfig(address=sitl.address, connect_timeout_s=30.0)) as px4:
        yield px4


async def until(px4: Px4Autopilot, accept: Callable[[VehicleState], bool], timeout_s: float) -> VehicleState:
    async with asyncio.timeout(timeout_s), aclosing(px4.states()) as states:
        async for state in states:
            if accept(state):
                return state
    raise AssertionError("the states ended")


async def fly(px4: Px4Autopilot, vel_ned_m_s: list[float], seconds: float) -> None:
    """Send a velocity at 50 Hz for a time."""
    end_s = time.monotonic() + seconds
    while (now_s := time.monotonic()) < end_s:
        await px4.send_setpoint(Setpoint(now_s, np.array(vel_ned_m_s), np.zeros(3), 0.0))
        await asyncio.sleep(0.02)


async def test_px4_states_come_at_the_rate_asked_with_the_time_of_the_attitude(px4: Px4Autopilot) -> None:
    await until(px4, lambda s: s.local_position_ok, 30.0)
    times_s, latencies_s = [], []
    async with aclosing(px4.states()) as states:
        async for state in states:
            times_s.append(state.t_capture_s)
            latencies_s.append(time.monotonic() - state.t_capture_s)
            if times_s[-1] - times_s[0] > 5.0:
                break
    assert len(times_s) / (times_s[-1] - times_s[0]) > 80.0
    assert (np.diff(times_s) > 0.0).all()
    assert float(np.median(latencies_s)) < 0.02


async def test_px4_flies_a_velocity_and_says_why_it_refuses(px4: Px4Autopilot) -> None:
    await until(px4, lambda s: s.armable and s.local_position_ok, 60.0)
    await px4.execute(AutopilotAction.ARM)
    await px4.execute(AutopilotAction.TAKEOFF, height_m=4.0)
    ground = await until(px4, lambda s: s.mode is FlightMode.TAKEOFF, 5.0)
    await until(px4, lambda s: s.landed is LandedState.IN_AIR and s.mode is FlightMode.HOLD, 30.0)
    with pytest.raises(AutopilotError, match=r"refused to disarm .*not landed"):
        await px4.execute(AutopilotAction.DISARM)
    await fly(px4, [0.0, 0.0, 0.0], 1.0)
    await px4.execute(AutopilotAction.OFFBOARD)
    before = await until(px4, lambda s: s.connected, 1.0)
    await fly(px4, [2.0, 0.0, 0.0], 4.0)
    after = await until(px4, lambda s: s.connected, 1.0)
    assert after.mode is FlightMode.OFFBOARD
    assert after.pos_ned_m[0] - before.pos_ned_m[0] > 4.0
    assert after.pos_ned_m[2] < ground.pos_ned_m[2] - 3.0
    await px4.execute(AutopilotAction.HOLD)
    await until(px4, lambda s: s.mode is FlightMode.HOLD, 2.0)
    await px4.execute(AutopilotAction.LAND)
    await until(px4, lambda s: not s.armed, 60.0)
