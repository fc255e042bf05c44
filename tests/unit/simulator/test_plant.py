"""The rigid body against worked mechanics."""

from __future__ import annotations

import math

import pytest

from app.config import PadMotionConfig
from drivers.simulator.contact import STIFFNESS_N_M
from drivers.simulator.pad import Pad
from drivers.simulator.plant import Airframe, Plant

G = 9.80665
FAR = Pad(PadMotionConfig(north_m=500.0))
CALM = (0.0, 0.0, 0.0)


def airborne(frame: Airframe, height_m: float = 200.0) -> Plant:
    plant = Plant(frame)
    plant.body.d = -height_m
    return plant


def test_plant_without_thrust_or_drag_falls_by_half_g_t_squared() -> None:
    plant = airborne(Airframe(drag_linear_n_s_m=0.0, drag_quadratic_n_s2_m2=0.0))
    for _ in range(500):
        plant.step(0.004, CALM, FAR.state)
    assert plant.body.vd == pytest.approx(G * 2.0, rel=1e-9)
    assert plant.body.d == pytest.approx(-200.0 + 0.5 * G * 4.0, abs=0.05)


def test_plant_falling_long_reaches_the_speed_at_which_drag_is_weight() -> None:
    k2, m = 0.03, 1.5
    plant = airborne(Airframe(mass_kg=m, drag_linear_n_s_m=0.4, drag_quadratic_n_s2_m2=k2), 2000.0)
    for _ in range(6000):
        plant.step(0.004, CALM, FAR.state)
    # Its rotors stand: of the two drags only the body's is left.
    assert plant.body.vd == pytest.approx(math.sqrt(m * G / k2), rel=1e-3)


def test_plant_with_a_quarter_of_hover_thrust_has_half_of_the_rotors_drag() -> None:
    frame = Airframe(drag_linear_n_s_m=0.5, drag_quadratic_n_s2_m2=0.0, motor_lag_s=1e-3)
    plant = airborne(frame)
    plant.command(True, (0.0, 0.0, 0.0), frame.hover_thrust / 4)
    for _ in range(2):
        plant.step(0.001, (0.0, 4.0, 0.0), FAR.state)
    assert plant.specific_force[1] == pytest.approx(0.5 * 0.5 * 4.0 / frame.mass_kg, rel=1e-2)


def test_plant_at_hover_thrust_keeps_its_height() -> None:
    frame = Airframe()
    plant = airborne(frame)
    plant.command(True, (0.0, 0.0, 0.0), frame.hover_thrust)
    for _ in range(250):
        plant.step(0.004, CALM, FAR.state)
    start = plant.body.vd
    for _ in range(250):
        plant.step(0.004, CALM, FAR.state)
    # Drag slows what it gained while the motors spun up; nothing else acts.
    assert 0.0 < plant.body.vd < start
    assert plant.specific_force[2] == pytest.approx(-G - 0.38 / 1.5 * plant.body.vd, abs=0.02)


def test_plant_level_in_a_steady_wind_takes_on_its_speed_with_mass_over_drag() -> None:
    frame = Airframe(drag_linear_n_s_m=0.5, drag_quadratic_n_s2_m2=0.0, motor_lag_s=0.004)
    plant = airborne(frame)
    plant.command(True, (0.0, 0.0, 0.0), frame.hover_thrust)
    time_constant_s = frame.mass_kg / 0.5
    for _ in range(round(time_constant_s / 0.004)):
        plant.step(0.004, (0.0, 4.0, 0.0), FAR.state)
    assert plant.body.ve == pytest.approx(4.0 * (1 - math.exp(-1)), rel=5e-3)


def test_plant_asked_for_a_rate_turns_with_its_first_order_lag() -> None:
    frame = Airframe(angular_damping_n_m_s=0.0)
    plant = airborne(frame)
    plant.command(True, (0.0, 0.0, 0.0), frame.hover_thrust)
    for _ in range(250):
        plant.step(0.001, CALM, FAR.state)
    plant.command(True, (1.0, 0.0, 0.0), frame.hover_thrust)
    for _ in range(45):
        plant.step(0.001, CALM, FAR.state)
    assert plant.body.p == pytest.approx(1.0 - math.exp(-45.0 / 45.0), abs=0.01)


def test_plant_turned_at_a_constant_rate_has_the_angle_of_rate_times_time() -> None:
    plant = airborne(Airframe())
    plant.body.r = 0.5
    for _ in range(250):
        plant.body.turn(0.004)
    assert 2.0 * math.atan2(plant.body.qz, plant.body.qw) == pytest.approx(0.5, abs=1e-9)


def test_plant_on_the_ground_rests_on_its_springs() -> None:
    plant = Plant()
    for _ in range(500):
        plant.step(0.004, (3.0, 0.0, 0.0), FAR.state)
    sag = 1.5 * G / (4 * STIFFNESS_N_M)
    assert plant.body.d == pytest.approx(sag - 0.12, abs=2e-4)
    # The wind leans on it and its friction holds: 3 m/s push it by less than the bristles' give.
    assert abs(plant.body.n) < 2e-3
    assert plant.feet.touching == 4


@pytest.mark.parametrize("wind_m_s", [16.0, 26.0])
def test_plant_with_its_motors_off_slides_once_the_wind_on_its_body_exceeds_friction(wind_m_s: float) -> None:
    plant = Plant()
    for _ in range(500):
        plant.step(0.004, (wind_m_s, 0.0, 0.0), FAR.state)
    # 0.02 N s^2/m^2 of body drag against 0.7 of 1.5 kg: friction holds up to 22.7 m/s.
    slid = plant.body.n > 0.05
    assert slid == (0.02 * wind_m_s**2 > 0.7 * 1.5 * G)


def test_plant_that_lands_at_a_walk_bounces_little_and_comes_to_rest() -> None:
    plant = Plant()
    plant.body.d -= 0.05
    plant.body.vd = 0.8
    rebound = 0.0
    for _ in range(500):
        plant.step(0.004, CALM, FAR.state)
        rebound = min(rebound, plant.body.vd)
    assert -0.5 < rebound < 0.0
    assert abs(plant.body.vd) < 1e-3
    assert plant.crashed is None
    assert plant.feet.impact_m_s == pytest.approx(math.sqrt(0.8**2 + 2 * G * 0.05), rel=0.05)


def test_plant_that_falls_from_two_metres_is_a_wreck() -> None:
    plant = Plant()
    plant.body.d -= 2.0
    for _ in range(500):
        plant.step(0.004, CALM, FAR.state)
    assert plant.crashed is not None
    assert "hit the ground" in plant.crashed


def test_plant_that_comes_down_on_its_side_is_a_wreck() -> None:
    plant = Plant()
    plant.body.d -= 0.3
    plant.body.qw, plant.body.qx = math.cos(0.7), math.sin(0.7)
    for _ in range(750):
        plant.step(0.004, CALM, FAR.state)
    assert plant.crashed == "tipped over"


class TestDeck:
    """The pad's deck: 1.2 m square, 1.6 m over the ground, straight ahead."""

    @staticmethod
    def on_deck(forward_m: float = 0.0, **motion: float) -> tuple[Plant, Pad]:
        pad = Pad(PadMotionConfig(north_m=0.0, east_m=0.0, height_m=1.6, deck_m=1.2, **motion))
        plant = Plant()
        plant.body.n = forward_m
        plant.body.d -= 1.6
        return plant, pad

    def test_deck_that_drives_off_carries_the_vehicle_along(self) -> None:
        plant, pad = self.on_deck(speed_m_s=3.75, acceleration_m_s2=1.5)
        for _ in range(1500):
            plant.step(0.004, CALM, pad.step(0.004, 1.6))
        assert pad.state.vel_north_m_s == pytest.approx(3.75)
        assert plant.body.vn == pytest.approx(3.75, abs=0.02)
        assert abs(plant.body.n - pad.state.north_m) < 0.02
        assert plant.feet.on_deck == 4

    def test_deck_that_shoots_off_slips_away_under_the_friction_limit(self) -> None:
        plant, pad = self.on_deck(speed_m_s=10.0, acceleration_m_s2=10.0)
        for _ in range(50):
            plant.step(0.004, CALM, pad.step(0.004, 1.6))
        # mu g is all that friction can give: 0.7 g for 0.2 s.
        assert plant.body.vn == pytest.approx(0.7 * G * 0.2, rel=0.12)
        assert pad.state.vel_north_m_s > plant.body.vn + 0.5

    def test_deck_edge_behind_the_middle_of_the_vehicle_lets_it_fall(self) -> None:
        plant, pad = self.on_deck(forward_m=0.65)
        for _ in range(1000):
            plant.step(0.004, CALM, pad.state)
        assert plant.body.d > -0.5
        assert plant.crashed is not None

    def test_deck_edge_in_front_of_the_front_feet_holds_it(self) -> None:
        plant, pad = self.on_deck(forward_m=0.42)
        for _ in range(1000):
            plant.step(0.004, CALM, pad.state)
        assert plant.body.d == pytest.approx(-1.72, abs=0.02)
        assert plant.crashed is None

    def test_deck_edge_between_front_feet_and_middle_leaves_it_on_its_belly(self) -> None:
        plant, pad = self.on_deck(forward_m=0.48)
        for _ in range(1000):
            plant.step(0.004, CALM, pad.state)
        pitch = 2.0 * math.asin(plant.body.qy)
        assert plant.crashed is None
        assert -1.72 < plant.body.d < -1.6
        assert -0.4 < pitch < -0.1

    def test_deck_hit_from_the_side_wrecks_the_vehicle(self) -> None:
        plant, pad = self.on_deck(forward_m=-2.0)
        plant.body.d += 0.6
        plant.command(True, (0.0, 0.0, 0.0), Airframe().hover_thrust)
        for _ in range(400):
            plant.body.vn, plant.body.vd = 2.0, 0.0
            plant.step(0.004, CALM, pad.state)
        assert plant.crashed == "struck the side of the pad's carrier"
