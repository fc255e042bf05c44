"""The land detector against the times that were measured on PX4 SITL after contact, and its rules one by one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from app.config import PadMotionConfig
from drivers.simulator.controller import Demand
from drivers.simulator.land_detector import Hysteresis, LandDetector, LandInputs
from drivers.simulator.params import Params

Fly = Callable[..., Any]


def come_down(fly: Fly, sink: float, forward: float = 0.0, errors: float = 1.0, **params: float) -> dict[str, float]:
    """Seconds from the first touch to each of the land detector's stages, with the velocity held."""
    flight = fly(errors=errors)
    flight.take_off(3.0)
    for name, value in params.items():
        flight.px4.params.set(name, value)
    flight.velocity(forward, 0.0, sink)
    assert flight.until(lambda: flight.world.plant.feet.touching > 0, 30.0) < 30.0
    start_s, times = flight.world.t_s, {}
    stages = {
        "contact": lambda: flight.px4.detector.ground_contact,
        "landed": lambda: flight.px4.detector.landed,
        "disarmed": lambda: not flight.px4.commander.armed,
    }

    def note() -> None:
        for name, reached in stages.items():
            if name not in times and reached():
                times[name] = flight.world.t_s - start_s

    flight.run(25.0, note)
    return times


@pytest.mark.parametrize(
    ("sink", "contact_s", "landed_s", "disarmed_s", "within_s"),
    [(0.5, 2.7, 5.0, 7.0, 1.4), (0.8, 1.0, 3.0, 5.0, 0.3), (1.5, 1.0, 3.2, 5.3, 0.3)],
)
def test_touchdown_is_detected_as_late_as_measured(
    flight: Fly, sink: float, contact_s: float, landed_s: float, disarmed_s: float, within_s: float
) -> None:
    times = come_down(flight, sink)
    assert times["contact"] == pytest.approx(contact_s, abs=within_s)
    assert times["landed"] == pytest.approx(landed_s, abs=within_s)
    assert times["disarmed"] == pytest.approx(disarmed_s, abs=within_s)


def test_touchdown_with_quick_parameters_disarms_within_a_second(flight: Fly) -> None:
    times = come_down(flight, 0.8, LNDMC_TRIG_TIME=0.2, COM_DISARM_LAND=0.1)
    assert times["contact"] < 0.4
    assert times["disarmed"] == pytest.approx(0.6, abs=0.3)


def test_touchdown_slower_than_the_detector_wants_is_never_told(flight: Fly) -> None:
    assert come_down(flight, 0.25, errors=0.0) == {}


def test_touchdown_with_zero_velocity_commanded_never_disarms(flight: Fly) -> None:
    one = flight(errors=1.0)
    one.take_off(3.0)
    one.velocity(0.0, 0.0, 0.8)
    one.until(lambda: one.world.plant.feet.touching > 0, 30.0)
    one.velocity(0.0, 0.0, 0.0)
    one.run(9.0)
    assert one.px4.commander.armed
    assert not one.px4.detector.landed


def test_forced_disarm_at_contact_is_obeyed_at_once(flight: Fly) -> None:
    one = flight(errors=1.0)
    one.take_off(3.0)
    one.velocity(0.0, 0.0, 0.8)
    one.until(lambda: one.world.plant.feet.touching > 0, 30.0)
    one.px4.disarm(force=True)
    assert not one.px4.commander.armed
    one.run(2.0)
    assert one.world.plant.crashed is None
    assert [contact.kind for contact in one.world.contacts] == ["touchdown", "rest"]


def over_a_moving_deck(fly: Fly, **params: float) -> Any:
    """A flight matched over a deck at 3.7 m/s that then sank onto it at 0.8 m/s."""
    deck = {"height_m": 1.6, "deck_m": 3.0, "speed_m_s": 3.7, "start_after_s": 16.0}
    flight = fly(motion=PadMotionConfig(north_m=6.0, east_m=0.0, **deck))
    for name, value in params.items():
        flight.px4.params.set(name, value)
    flight.take_off(4.0)

    def follow() -> float:
        pad = flight.world.pad.state
        ahead, aside = pad.north_m - flight.body.n, pad.east_m - flight.body.e
        flight.setpoint = Demand(
            velocity=(pad.vel_north_m_s + ahead, aside, 0.3 * (-4.0 - flight.body.d)),
            acceleration=(1.0 if 0.0 < pad.vel_north_m_s < 3.7 else 0.0, 0.0, 0.0),
            yaw=0.0,
        )
        flight.run(0.02)
        return math.hypot(ahead, aside)

    assert flight.until(lambda: follow() < 0.1 and flight.world.pad.state.vel_north_m_s > 3.69, 60.0) < 60.0
    flight.velocity(3.7, 0.0, 0.8)
    assert flight.until(lambda: flight.world.plant.feet.on_deck > 0, 8.0) < 8.0
    return flight


def test_deck_faster_than_the_detector_allows_is_never_ground(flight: Fly) -> None:
    one = over_a_moving_deck(flight)
    one.run(6.0)
    assert not one.px4.detector.ground_contact
    assert one.px4.commander.armed


def test_deck_with_the_speed_limit_lifted_is_ground_within_about_a_second(flight: Fly) -> None:
    one = over_a_moving_deck(flight, LNDMC_XY_VEL_MAX=10.0, LNDMC_TRIG_TIME=0.3, COM_DISARM_LAND=0.1)
    assert one.until(lambda: not one.px4.commander.armed, 5.0) == pytest.approx(1.0, abs=0.4)
    assert one.world.contacts[-1].on_deck


# ------------------------------------------------------------------------------------------------------- the rules
STANDING = LandInputs(
    armed=True,
    thrust=0.12,
    climb_rate_controlled=True,
    velocity_demand_down=0.7,
    vertical_speed=0.0,
    height_rate=0.0,
    horizontal_speed=0.0,
    tilt_rate=0.0,
    specific_force=9.8,
)
FLYING = LandInputs(
    armed=True,
    thrust=0.5,
    climb_rate_controlled=True,
    velocity_demand_down=0.0,
    vertical_speed=0.0,
    height_rate=0.0,
    horizontal_speed=0.0,
    tilt_rate=0.0,
    specific_force=9.8,
)


def detect(seen: LandInputs, seconds: float) -> LandDetector:
    detector = LandDetector(Params())
    detector.step(0.0, FLYING)
    for k in range(round(seconds / 0.01)):
        detector.step(0.01 * (k + 1), seen)
    return detector


def changed(**fields: Any) -> LandInputs:
    return LandInputs(**{**{name: getattr(STANDING, name) for name in LandInputs.__slots__}, **fields})


def test_detector_goes_through_its_three_stages_one_second_each() -> None:
    # The first look at each condition starts its own second.
    assert not detect(STANDING, 0.95).ground_contact
    assert detect(STANDING, 1.1).ground_contact
    assert not detect(STANDING, 1.1).maybe_landed
    assert detect(STANDING, 2.1).maybe_landed
    assert detect(STANDING, 3.2).landed


@pytest.mark.parametrize(
    "fields",
    [
        {"thrust": 0.36},
        {"velocity_demand_down": 0.27},
        {"velocity_demand_down": math.nan},
        {"vertical_speed": 0.26, "height_rate": 0.26},
        {"horizontal_speed": 1.6},
    ],
    ids=lambda fields: "-".join(fields),
)
def test_detector_denies_ground_contact_while_anything_speaks_against_it(fields: dict[str, float]) -> None:
    assert not detect(changed(**fields), 5.0).ground_contact


@pytest.mark.parametrize(
    "fields", [{"thrust": 0.2}, {"tilt_rate": 0.4}, {"specific_force": 1.0}], ids=lambda fields: "-".join(fields)
)
def test_detector_denies_landed_while_thrust_rotation_or_free_fall_speak_against_it(fields: dict[str, float]) -> None:
    detector = detect(changed(**fields), 5.0)
    assert detector.ground_contact
    assert not detector.landed


def test_detector_calls_a_disarmed_vehicle_landed() -> None:
    assert detect(changed(armed=False, thrust=0.0, velocity_demand_down=math.nan), 3.2).landed


def test_hysteresis_falls_at_once_and_rises_late() -> None:
    hysteresis = Hysteresis()
    assert not hysteresis.update(True, 0.0, 1.0)
    assert not hysteresis.update(True, 0.9, 1.0)
    assert hysteresis.update(True, 1.0, 1.0)
    assert not hysteresis.update(False, 1.1, 1.0)
    assert not hysteresis.update(True, 1.2, 1.0)
