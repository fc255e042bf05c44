"""The flight controller against what was measured on PX4 SITL (its built-in SIH quadrotor, steadied)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from app.messages import FlightMode
from drivers.simulator.commander import Result
from drivers.simulator.controller import NAN, Demand

Fly = Callable[..., Any]


def respond(fly: Fly, velocity: tuple[float, float, float], seconds: float = 8.0) -> list[tuple[float, float]]:
    """(time, share of the step) of a velocity step from rest."""
    flight = fly()
    flight.take_off(20.0)
    axis = max(range(3), key=lambda k: abs(velocity[k]))
    start_s, before = flight.world.t_s, (flight.body.vn, flight.body.ve, flight.body.vd)[axis]
    shares: list[tuple[float, float]] = []
    flight.velocity(*velocity)

    def note() -> None:
        now = (flight.body.vn, flight.body.ve, flight.body.vd)[axis]
        shares.append((flight.world.t_s - start_s, (now - before) / (velocity[axis] - before)))

    flight.run(seconds, note)
    return shares


def first(shares: list[tuple[float, float]], level: float) -> float:
    return next(t for t, share in shares if share >= level)


@pytest.mark.parametrize(
    ("velocity", "dead_s", "t63_s", "t90_s", "t90_within_s", "overshoot"),
    [
        ((3.7, 0.0, 0.0), 0.2, 0.70, 1.4, 0.2, 0.05),
        ((0.0, 1.0, 0.0), 0.2, 0.66, 1.3, 0.2, 0.11),
        ((0.0, 0.0, 0.8), 0.1, 0.30, 0.75, 0.35, 0.17),
        ((0.0, 0.0, -0.8), 0.06, 0.25, 0.4, 0.2, 0.25),
    ],
    ids=["horizontal 3.7", "horizontal 1", "down 0.8", "up 0.8"],
)
def test_px4_velocity_step_rises_as_measured(
    flight: Fly,
    velocity: tuple[float, float, float],
    dead_s: float,
    t63_s: float,
    t90_s: float,
    t90_within_s: float,
    overshoot: float,
) -> None:
    shares = respond(flight, velocity)
    assert first(shares, 0.05) == pytest.approx(dead_s, abs=0.09)
    assert first(shares, 0.63) == pytest.approx(t63_s, rel=0.1, abs=0.06)
    assert first(shares, 0.90) == pytest.approx(t90_s, abs=t90_within_s)
    assert max(share for _, share in shares) - 1.0 < overshoot
    assert shares[-1][1] == pytest.approx(1.0, abs=0.03)


def test_px4_velocity_step_lags_by_what_was_measured(flight: Fly) -> None:
    shares = respond(flight, (3.7, 0.0, 0.0))
    assert sum((1.0 - share) * 0.004 for _, share in shares) == pytest.approx(0.7, abs=0.15)


def test_px4_acceleration_fed_forward_cuts_the_lag(flight: Fly) -> None:
    """A ramp of 1.5 m/s2 followed with and without the ramp's own acceleration."""

    def behind(acceleration: float) -> float:
        one = flight()
        one.take_off(20.0)
        start_s = one.world.t_s
        while one.world.t_s - start_s < 2.0:
            speed = 1.5 * (one.world.t_s - start_s)
            one.setpoint = Demand(velocity=(speed, 0.0, 0.0), acceleration=(acceleration, 0.0, 0.0), yaw=0.0)
            one.run(0.02)
        return 1.5 * 2.0 - one.body.vn

    assert behind(1.5) < 0.5 * behind(0.0)


def test_px4_position_setpoint_is_reached_and_held(flight: Fly) -> None:
    one = flight()
    one.take_off(5.0)
    one.setpoint = Demand(position=(4.0, -3.0, -8.0), velocity=(0.0, 0.0, 0.0), yaw=1.2)
    one.run(12.0)
    now = one.px4.estimate
    assert math.dist((now.n, now.e, now.d), (4.0, -3.0, -8.0)) < 0.15
    assert now.yaw == pytest.approx(1.2, abs=0.03)


def test_px4_acceleration_alone_is_a_setpoint(flight: Fly) -> None:
    one = flight()
    one.take_off(10.0)
    one.setpoint = Demand(acceleration=(1.0, 0.0, 0.0))
    one.run(1.5)
    assert one.body.vn == pytest.approx(1.2, abs=0.3)


def test_px4_setpoint_that_leaves_an_axis_free_is_ignored(flight: Fly) -> None:
    one = flight()
    one.take_off(5.0)
    one.setpoint = Demand(velocity=(1.0, 0.0, NAN))
    one.run(1.5)
    assert one.px4.commander.mode is FlightMode.HOLD  # the stream counts as lost


def test_px4_speed_is_limited_to_its_parameters(flight: Fly) -> None:
    one = flight()
    one.take_off(30.0)
    one.px4.params.set("MPC_XY_VEL_MAX", 2.0)
    one.velocity(9.0, 9.0, 4.0)
    one.run(6.0)
    assert math.hypot(one.body.vn, one.body.ve) == pytest.approx(2.0, abs=0.1)
    assert one.body.vd == pytest.approx(1.5, abs=0.1)


def test_px4_with_estimate_errors_wanders_as_measured(flight: Fly) -> None:
    """The report differs from the truth by 0.1 to 0.4 m horizontally and 0.3 to 1.0 m vertically."""
    one = flight(errors=1.0, seed=4)
    one.take_off(10.0)
    horizontal: list[float] = []
    vertical: list[float] = []
    speed: list[float] = []

    def note() -> None:
        now, body = one.px4.estimate, one.body
        horizontal.append(math.hypot(now.n - body.n, now.e - body.e))
        vertical.append(abs(now.d - (body.d + 0.1167)))
        speed.append((now.vn - body.vn) ** 2)

    one.run(70.0, note)
    assert 0.05 < math.sqrt(sum(h * h for h in horizontal) / len(horizontal)) < 0.45
    assert max(vertical) < 1.6
    assert 0.05 < math.sqrt(sum(speed) / len(speed)) < 0.15


def test_px4_flights_of_one_seed_are_equal_and_of_two_differ(flight: Fly) -> None:
    ends = []
    for seed in (3, 3, 4):
        one = flight(errors=1.0, gust_m_s=1.0, seed=seed)
        one.take_off(4.0)
        ends.append((one.body.n, one.body.e, one.body.d))
    assert ends[0] == ends[1]
    assert ends[0] != ends[2]


def test_px4_takeoff_climbs_to_its_height_and_holds(flight: Fly) -> None:
    one = flight()
    one.run(3.1)
    assert one.px4.arm() is Result.ACCEPTED
    assert one.px4.takeoff(6.0) is Result.ACCEPTED
    assert one.px4.landed_state.value == "on_ground"
    assert one.until(lambda: one.px4.landed_state.value == "taking_off", 6.0) < 6.0
    assert one.until(lambda: one.px4.commander.mode is FlightMode.HOLD, 15.0) < 12.0
    one.run(6.0)
    assert -one.px4.estimate.d == pytest.approx(6.0, abs=0.1)
    assert one.px4.landed_state.value == "in_air"


def test_px4_return_climbs_flies_home_lands_and_disarms(flight: Fly) -> None:
    one = flight()
    one.take_off(5.0)
    one.velocity(4.0, 0.0, 0.0)
    one.run(4.0)
    one.px4.params.set("RTL_RETURN_ALT", 12.0)
    assert one.px4.set_mode(FlightMode.RETURN) is Result.ACCEPTED
    highest = 0.0

    def note() -> None:
        nonlocal highest
        highest = max(highest, -one.px4.estimate.d)

    one.run(50.0, note)
    assert highest == pytest.approx(12.0, abs=1.0)
    assert not one.px4.commander.armed
    assert math.hypot(one.body.n, one.body.e) < 1.5
    assert one.world.plant.crashed is None
