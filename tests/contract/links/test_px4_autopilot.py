"""The link to PX4, against an autopilot that shares no code with it and whose clock and flight are known."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as mavlink

from app.config import AutopilotConfig
from app.errors import AutopilotError
from app.messages import AutopilotAction, FlightMode, LandedState, LandingTarget, Setpoint, VehicleState
from app.ports import Autopilot
from drivers.autopilot.px4_mavsdk import Px4Autopilot

OFFBOARD_MODE = 6 << 16


def config_of(port: int, **changes: Any) -> AutopilotConfig:
    return AutopilotConfig(address=f"udpin://127.0.0.1:{port}", **{"connect_timeout_s": 10.0, **changes})


def setpoint(age_s: float = 0.0, *, north: float = 1.0, acc_north: float = 0.0) -> Setpoint:
    return Setpoint(time.monotonic() - age_s, np.array([north, -2.0, 0.5]), np.array([acc_north, 0.0, 0.0]), 0.25)


@pytest.fixture
async def link(autopilot: Any, port: int) -> AsyncIterator[Autopilot]:
    async with Px4Autopilot(config_of(port)) as link:
        yield link


async def state_where(link: Autopilot, accept: Callable[[VehicleState], bool], timeout_s: float = 8.0) -> VehicleState:
    async with asyncio.timeout(timeout_s):
        async with aclosing(link.states()) as states:
            async for state in states:
                if accept(state):
                    return state
    raise AssertionError("the states ended")


async def wait(call: Callable[..., Any], *args: Any, **named: Any) -> Any:
    return await asyncio.to_thread(call, *args, **named)


# ------------------------------------------------------------------------------------------------------------- opening
async def test_autopilot_open_takes_the_drones_system_id_and_component_191(
    make_autopilot: Callable[..., Any], port: int
) -> None:
    autopilot = make_autopilot(system_id=7)
    async with Px4Autopilot(config_of(port)) as link:
        assert link.system_id == 7
        beat = await wait(autopilot.station.wait_for, "HEARTBEAT", lambda m: m.get_srcSystem() == 7)
    assert (beat.get_srcComponent(), beat.type) == (191, 18)


async def test_autopilot_open_asks_for_the_configured_attitude_rate(link: Autopilot, autopilot: Any) -> None:
    intervals_us = {m.param1: m.param2 for m in autopilot.commands if m.command == 511}
    assert (intervals_us[31], intervals_us[32]) == (10_000.0, 10_000.0)


async def test_autopilot_without_a_heartbeat_is_an_error_that_names_the_address(port: int) -> None:
    address = f"udpin://127.0.0.1:{port}"
    with pytest.raises(AutopilotError, match=rf"{address}: no autopilot's heartbeat within 0\.3 s; start PX4"):
        async with Px4Autopilot(config_of(port, connect_timeout_s=0.3)):
            pass


async def test_autopilot_port_in_use_is_an_error_that_names_it(link: Autopilot, port: int) -> None:
    with pytest.raises(AutopilotError, match=f"another program holds port {port}"):
        async with Px4Autopilot(config_of(port)):
            pass


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("serial:///dev/no-such-port:57600", "/dev/no-such-port does not exist"),
        ("serial:///dev/shm:57600", "/dev/shm is no serial port"),
        ("udpin://192.0.2.1:24601", "can't listen there"),
        ("udpin://127.0.0.1:70000", "port 70000 is outside"),
        ("udpin://nonsense", "not an address"),
    ],
)
async def test_autopilot_address_that_cannot_work_is_refused_at_once(address: str, says: str) -> None:
    with pytest.raises(AutopilotError, match=says):
        async with Px4Autopilot(AutopilotConfig(address=address)):
            pass


# ----------------------------------------------------------------------------------------------------------- telemetry
async def test_autopilot_state_is_true_at_its_time(link: Autopilot, autopilot: Any) -> None:
    state = await state_where(link, lambda s: s.local_position_ok)
    # The vehicle flies at 3 m/s, so 6 cm are 20 ms of error in the state's time.
    np.testing.assert_allclose(state.pos_ned_m, autopilot.position_at(state.t_capture_s), atol=0.06)
    np.testing.assert_allclose(state.vel_ned_m_s, [3.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(state.q_ned_from_body_wxyz, [1.0, 0.0, 0.0, 0.0])
    assert 0.0 <= time.monotonic() - state.t_capture_s < 0.2


async def test_autopilot_state_tells_mode_landed_arming_and_battery(link: Autopilot, autopilot: Any) -> None:
    state = await state_where(link, lambda s: s.armable and s.landed is LandedState.IN_AIR)
    assert (state.mode, state.armed, state.battery_fraction) == (FlightMode.HOLD, False, 0.8)
    autopilot.custom_mode, autopilot.armed = OFFBOARD_MODE, True
    state = await state_where(link, lambda s: s.armed)
    assert state.mode is FlightMode.OFFBOARD


async def test_autopilot_jump_of_the_local_frame_is_counted(link: Autopilot, autopilot: Any) -> None:
    before = await state_where(link, lambda s: s.local_position_ok)
    autopilot.motion.jump = (0.0, 1.0, 0.0)
    after = await state_where(link, lambda s: float(s.pos_ned_m[1] - before.pos_ned_m[1]) > 0.9)
    assert (before.frame_resets, after.frame_resets) == (0, 1)


async def test_autopilot_states_after_a_stall_of_the_event_loop_are_true_at_their_times(
    link: Autopilot, autopilot: Any
) -> None:
    def stall() -> None:
        time.sleep(0.6)

    await state_where(link, lambda s: s.local_position_ok)
    # Between two ticks of the autopilot, so that an attitude is the first of what piles up.
    asyncio.get_running_loop().call_later(0.005, stall)
    end_s = time.monotonic() + 0.8
    states: list[VehicleState] = []
    await state_where(link, lambda s: states.append(s) or time.monotonic() > end_s)  # type: ignore[func-returns-value]  # append returns None
    assert {s.local_position_ok for s in states} == {True}
    errors_m = [np.abs(s.pos_ned_m - autopilot.position_at(s.t_capture_s)).max() for s in states]
    assert max(errors_m) < 0.06


async def test_autopilot_link_loss_shows_twice_a_second_and_ends_with_the_rates_asked_again(
    link: Autopilot, autopilot: Any
) -> None:
    await state_where(link, lambda s: s.connected)
    autopilot.talking = False
    lost = await state_where(link, lambda s: not s.connected, timeout_s=3.0)
    again = await state_where(link, lambda s: s.t_capture_s == lost.t_capture_s, timeout_s=0.5)
    assert not again.connected
    autopilot.station.forget()
    autopilot.talking = True
    state = await state_where(link, lambda s: s.connected)
    assert state.t_capture_s > lost.t_capture_s
    await wait(autopilot.station.wait_for, "COMMAND_LONG", lambda m: m.command == 511 and m.param1 == 31)


# ----------------------------------------------------------------------------------------------------------- setpoints
@pytest.mark.parametrize(("acc_north", "type_mask"), [(0.0, 2503), (0.7, 2055)])
async def test_autopilot_setpoint_arrives_once_as_velocity_and_yaw(
    link: Autopilot, autopilot: Any, acc_north: float, type_mask: int
) -> None:
    sent_s = time.monotonic()
    await link.send_setpoint(setpoint(acc_north=acc_north))
    message = await wait(autopilot.station.wait_for, "SET_POSITION_TARGET_LOCAL_NED")
    assert (message.coordinate_frame, message.type_mask) == (1, type_mask)
    assert (message.target_system, message.target_component) == (1, 1)
    np.testing.assert_allclose([message.vx, message.vy, message.vz, message.yaw], [1.0, -2.0, 0.5, 0.25])
    assert message.afx == pytest.approx(acc_north)
    assert message.time_boot_ms / 1000.0 == pytest.approx(sent_s - autopilot.boot_offset_s, abs=0.1)
    with pytest.raises(TimeoutError):
        await wait(autopilot.station.wait_for, "SET_POSITION_TARGET_LOCAL_NED", timeout_s=0.7)


async def test_autopilot_setpoint_that_is_old_never_leaves(link: Autopilot, autopilot: Any) -> None:
    await link.send_setpoint(setpoint(age_s=0.3, north=9.0))
    await link.send_setpoint(setpoint(north=1.0))
    message = await wait(autopilot.station.wait_for, "SET_POSITION_TARGET_LOCAL_NED")
    assert message.vx == 1.0


async def test_autopilot_setpoint_that_is_not_finite_is_refused(link: Autopilot) -> None:
    with pytest.raises(ValueError, match="not finite"):
        await link.send_setpoint(setpoint(north=float("nan")))


# ----------------------------------------------------------------------------------------------------- landing targets
async def test_autopilot_landing_target_arrives_as_px4s_precision_landing_takes_it(
    link: Autopilot, autopilot: Any
) -> None:
    before_s = time.time()
    await link.send_landing_target(LandingTarget(time.monotonic() - 0.1, np.array([1.5, -2.25, 0.75]), 0.5))
    message = await wait(autopilot.station.wait_for, "LANDING_TARGET")
    assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 191)
    assert message.position_valid == 1
    assert message.frame == mavlink.MAV_FRAME_LOCAL_NED
    assert message.type == mavlink.LANDING_TARGET_TYPE_VISION_FIDUCIAL
    np.testing.assert_allclose([message.x, message.y, message.z], [1.5, -2.25, 0.75])
    np.testing.assert_allclose(message.q, [math.cos(0.25), 0.0, 0.0, math.sin(0.25)], atol=1e-6)
    assert message.time_usec * 1e-6 == pytest.approx(before_s - 0.1, abs=0.1)
    with pytest.raises(TimeoutError):
        await wait(autopilot.station.wait_for, "LANDING_TARGET", timeout_s=0.5)


async def test_autopilot_landing_target_that_is_old_never_leaves(link: Autopilot, autopilot: Any) -> None:
    await link.send_landing_target(LandingTarget(time.monotonic() - 0.3, np.array([9.0, 0.0, 0.0]), 0.0))
    await link.send_landing_target(LandingTarget(time.monotonic(), np.array([1.0, 0.0, 0.0]), 0.0))
    assert (await wait(autopilot.station.wait_for, "LANDING_TARGET")).x == 1.0


@pytest.mark.parametrize("bad", [math.nan, math.inf])
async def test_autopilot_landing_target_that_is_not_finite_is_refused(link: Autopilot, bad: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        await link.send_landing_target(LandingTarget(time.monotonic(), np.array([0.0, bad, 0.0]), 0.0))


# ------------------------------------------------------------------------------------------------------------- actions
@pytest.mark.parametrize(
    ("action", "command", "params"),
    [
        (AutopilotAction.ARM, 400, (1.0, 0.0)),
        (AutopilotAction.DISARM, 400, (0.0, 0.0)),
        (AutopilotAction.FORCE_DISARM, 400, (0.0, 21196.0)),
        (AutopilotAction.OFFBOARD, 176, (1.0, 6.0, 0.0)),
        (AutopilotAction.HOLD, 176, (1.0, 4.0, 3.0)),
        (AutopilotAction.LAND, 176, (1.0, 4.0, 6.0)),
        (AutopilotAction.PRECLAND, 176, (1.0, 4.0, 9.0)),
        (AutopilotAction.RETURN, 176, (1.0, 4.0, 5.0)),
    ],
)
async def test_autopilot_action_is_the_command_that_px4_takes(
    link: Autopilot, autopilot: Any, action: AutopilotAction, command: int, params: tuple[float, ...]
) -> None:
    await link.execute(action)
    message = next(m for m in autopilot.commands if m.command == command)
    assert (message.param1, message.param2, message.param3)[: len(params)] == params
    assert (message.target_system, message.target_component) == (1, 1)


async def test_autopilot_takeoff_climbs_to_the_height_above_the_present_place(link: Autopilot, autopilot: Any) -> None:
    await state_where(link, lambda s: s.local_position_ok and s.armable)
    await link.execute(AutopilotAction.TAKEOFF, height_m=4.0)
    message = next(m for m in autopilot.commands if m.command == 22)
    assert message.param7 == 492.5  # the autopilot is at 488.5 m above sea level
    assert np.isnan([message.param4, message.param5, message.param6]).all()


async def test_autopilot_refusal_carries_its_result_and_words(link: Autopilot, autopilot: Any) -> None:
    autopilot.results[400] = 1
    autopilot.words[400] = "Preflight Fail: compass"
    with pytest.raises(AutopilotError, match=r"refused to arm \(TEMPORARILY_REJECTED\): Preflight Fail: compass"):
        await link.execute(AutopilotAction.ARM)


async def test_autopilot_silence_ends_an_action_in_its_time(make_autopilot: Callable[..., Any], port: int) -> None:
    autopilot = make_autopilot()
    async with Px4Autopilot(config_of(port, action_timeout_s=0.4)) as link:
        autopilot.results[176] = None
        start_s = time.monotonic()
        with pytest.raises(AutopilotError, match=r"no final answer to hold within 0\.4 s"):
            await link.execute(AutopilotAction.HOLD)
        assert time.monotonic() - start_s < 1.0


async def test_autopilot_forced_disarm_without_an_answer_is_not_sent_again(link: Autopilot, autopilot: Any) -> None:
    """It was right for that instant; PX4 obeys it in the air too."""
    autopilot.results[400] = None
    with pytest.raises(AutopilotError, match="did not answer"):
        await link.execute(AutopilotAction.FORCE_DISARM)
    await asyncio.sleep(1.0)
    assert len([m for m in autopilot.commands if m.command == 400]) == 1


async def test_autopilot_closed_refuses_to_act(autopilot: Any, port: int) -> None:
    link = Px4Autopilot(config_of(port))
    async with link:
        pass
    with pytest.raises(AutopilotError, match="closed"):
        await link.execute(AutopilotAction.HOLD)
    with pytest.raises(AutopilotError, match="closed"):
        await link.send_setpoint(setpoint())
    with pytest.raises(AutopilotError, match="closed"):
        async with aclosing(link.states()) as states:
            await anext(states)
