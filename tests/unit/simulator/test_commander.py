"""Arming, modes and failsafes, by PX4's rules."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from app.messages import FlightMode
from drivers.simulator.commander import Result
from drivers.simulator.controller import Demand

Fly = Callable[..., Any]
STILL = Demand(velocity=(0.0, 0.0, 0.0), yaw=0.0)


def test_arming_before_the_estimator_is_ready_is_refused_with_a_reason(flight: Fly) -> None:
    one = flight()
    one.run(1.0)
    assert one.px4.arm() is Result.TEMPORARILY_REJECTED
    assert "not ready" in one.px4.commander.texts[-1].text


def test_arming_three_seconds_after_the_start_is_accepted(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    assert one.px4.arm() is Result.ACCEPTED


def test_arming_by_force_passes_the_checks(flight: Fly) -> None:
    one = flight()
    one.run(0.5)
    assert one.px4.arm(force=True) is Result.ACCEPTED


def test_arming_in_a_landing_mode_is_refused(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    one.px4.set_mode(FlightMode.LAND)
    assert one.px4.arm() is Result.TEMPORARILY_REJECTED


def test_armed_vehicle_that_never_takes_off_disarms_after_ten_seconds(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    one.px4.arm()
    assert one.until(lambda: not one.px4.commander.armed, 20.0) == pytest.approx(10.0, abs=0.1)


def test_offboard_without_a_stream_is_refused(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    assert one.px4.set_mode(FlightMode.OFFBOARD) is Result.TEMPORARILY_REJECTED
    assert one.px4.commander.mode is FlightMode.HOLD


def test_offboard_after_a_single_setpoint_is_refused(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    one.px4.offboard_setpoint(STILL)
    one.run(0.1)
    assert one.px4.set_mode(FlightMode.OFFBOARD) is Result.TEMPORARILY_REJECTED


def test_offboard_with_a_stream_slower_than_two_a_second_is_refused(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    for _ in range(4):
        one.px4.offboard_setpoint(STILL)
        one.run(0.6)
    one.px4.offboard_setpoint(STILL)
    assert one.px4.set_mode(FlightMode.OFFBOARD) is Result.TEMPORARILY_REJECTED


def test_offboard_with_a_live_stream_is_accepted(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    one.setpoint = STILL
    one.run(1.0)
    assert one.px4.set_mode(FlightMode.OFFBOARD) is Result.ACCEPTED


@pytest.mark.parametrize("loss_s", [0.5, 1.0])
def test_offboard_loss_holds_the_last_velocity_until_its_time_and_then_hold(flight: Fly, loss_s: float) -> None:
    one = flight()
    one.take_off(10.0)
    one.px4.params.set("COM_OF_LOSS_T", loss_s)
    one.velocity(3.7, 0.0, 0.0)
    one.run(6.0)
    one.setpoint = None
    start_n = one.body.n
    lost_s = one.until(lambda: one.px4.commander.mode is FlightMode.HOLD, 3.0)
    assert lost_s == pytest.approx(loss_s, abs=0.03)
    assert one.body.n - start_n == pytest.approx(3.7 * loss_s, rel=0.06)
    one.run(6.0)
    # Measured: stops within 8.5 m of the last setpoint, of which 3.7 m in the first second.
    assert one.body.n - start_n - 3.7 * loss_s < 8.5 - 3.7
    assert math.hypot(one.body.vn, one.body.ve) < 0.1


@pytest.mark.parametrize(
    ("action", "mode"), [(0, FlightMode.POSITION), (3, FlightMode.RETURN), (4, FlightMode.LAND), (5, FlightMode.HOLD)]
)
def test_offboard_loss_goes_where_its_parameter_says(flight: Fly, action: int, mode: FlightMode) -> None:
    one = flight()
    one.take_off(5.0)
    one.px4.params.set("COM_OBL_RC_ACT", action)
    one.setpoint = None
    one.run(1.2)
    assert one.px4.commander.mode is mode
    assert one.px4.commander.intent is FlightMode.OFFBOARD


def test_offboard_loss_with_action_disarm_drops_the_vehicle(flight: Fly) -> None:
    one = flight()
    one.take_off(5.0)
    one.px4.params.set("COM_OBL_RC_ACT", 7)
    one.setpoint = None
    one.run(1.2)
    assert not one.px4.commander.armed


def test_offboard_resumes_by_itself_when_setpoints_resume(flight: Fly) -> None:
    one = flight()
    one.take_off(5.0)
    one.setpoint = None
    one.run(2.0)
    assert one.px4.commander.mode is FlightMode.HOLD
    one.velocity(1.0, 0.0, 0.0)
    one.run(0.1)
    assert one.px4.commander.mode is FlightMode.OFFBOARD
    one.run(3.0)
    assert one.body.vn == pytest.approx(1.0, abs=0.1)


def test_pilot_who_takes_position_keeps_it_though_setpoints_go_on(flight: Fly) -> None:
    one = flight()
    one.take_off(5.0)
    one.velocity(3.0, 0.0, 0.0)
    one.run(2.0)
    assert one.px4.set_mode(FlightMode.POSITION) is Result.ACCEPTED
    one.run(5.0)
    assert one.px4.commander.mode is FlightMode.POSITION
    assert math.hypot(one.body.vn, one.body.ve) < 0.1
    one.px4.sticks = (0.0, 2.0, 0.0)
    one.run(4.0)
    assert one.body.ve == pytest.approx(2.0, abs=0.15)


def test_disarm_in_the_air_is_refused_and_by_force_obeyed_at_once(flight: Fly) -> None:
    one = flight()
    one.take_off(5.0)
    assert one.px4.disarm() is Result.TEMPORARILY_REJECTED
    assert "not landed" in one.px4.commander.texts[-1].text
    assert one.px4.commander.armed
    assert one.px4.disarm(force=True) is Result.ACCEPTED
    one.run(0.5)
    assert not one.px4.commander.armed
    assert one.body.vd > 3.0


def test_disarm_on_the_ground_is_accepted(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    one.px4.arm()
    assert one.px4.disarm() is Result.ACCEPTED
    assert not one.px4.commander.armed
