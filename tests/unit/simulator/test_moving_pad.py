"""Pads that bend, brake and ride on waves, by geometry and mechanics."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.config import PadMotionConfig
from app.frames import rotation_from_euler
from drivers.simulator.estimate import Estimator
from drivers.simulator.pad import Pad, PadState
from drivers.simulator.plant import Plant, RigidBody

STEP_S = 0.004


def drive(motion: PadMotionConfig, seconds: float, seed: int = 0) -> list[PadState]:
    pad = Pad(motion, seed)
    return [pad.step(STEP_S, 2.0) for _ in range(round(seconds / STEP_S))]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_pad_in_a_bend_drives_on_its_circle(side):
    motion = PadMotionConfig(north_m=0.0, east_m=0.0, speed_m_s=3.75, acceleration_m_s2=5.0, bend_radius_m=30.0 * side)
    states = drive(motion, 40.0)[1000:]  # steered in after 4 s
    centres = [
        (s.north_m - 30.0 * side * math.sin(s.heading_rad), s.east_m + 30.0 * side * math.cos(s.heading_rad))
        for s in states
    ]
    assert np.ptp(np.array(centres), axis=0) == pytest.approx([0.0, 0.0], abs=0.01)
    assert states[-1].heading_rate_rad_s == pytest.approx(side * 0.125)
    assert math.hypot(states[-1].vel_north_m_s, states[-1].vel_east_m_s) == pytest.approx(3.75)


def test_pad_that_brakes_stops_in_v_squared_over_two_a():
    motion = PadMotionConfig(north_m=0.0, speed_m_s=4.0, acceleration_m_s2=2.0, brake_after_s=3.0, brake_m_s2=2.0)
    states = drive(motion, 20.0)
    # 4 m to get up to speed in 2 s, 3 s at 4 m/s, 4 m to stop.
    assert states[-1].north_m == pytest.approx(4.0 + 12.0 + 4.0, abs=0.05)
    assert (states[-1].vel_north_m_s, states[-1].vel_east_m_s) == (0.0, 0.0)


def test_pad_that_waits_for_a_vehicle_counts_only_one_that_is_near():
    pad = Pad(PadMotionConfig(north_m=0.0, east_m=0.0, speed_m_s=2.0, start_after_s=1.0, start_near_m=1.5))
    for _ in range(500):
        pad.step(STEP_S, 3.0, (4.0, 0.0))
    assert pad.state.vel_north_m_s == 0.0
    for _ in range(300):
        pad.step(STEP_S, 3.0, (1.0, 0.0))
    assert pad.state.vel_north_m_s > 0.0


SEA = PadMotionConfig(height_m=1.3, roll_deg=8.0, pitch_deg=8.0, heave_m=1.0, wave_period_s=7.0)


def test_deck_on_waves_stays_within_its_amplitudes_and_uses_most_of_them():
    states = drive(SEA, 300.0, seed=4)
    roll = [math.degrees(s.roll_rad) for s in states]
    heave = [-s.down_m - 1.3 for s in states]
    assert 6.0 < max(roll) <= 8.0
    assert -8.0 <= min(roll) < -6.0
    assert 0.75 < max(heave) <= 1.0


def test_deck_on_waves_moves_as_its_rates_say():
    states = drive(SEA, 5.0, seed=2)
    for name, rate in (("down_m", "vel_down_m_s"), ("roll_rad", "roll_rate_rad_s"), ("pitch_rad", "pitch_rate_rad_s")):
        values = np.array([getattr(s, name) for s in states])
        rates = np.array([getattr(s, rate) for s in states])
        assert np.gradient(values, STEP_S)[1:-1] == pytest.approx(rates[1:-1], abs=1e-3)


def test_waves_of_another_seed_are_other_waves():
    one, same, other = (drive(SEA, 2.0, seed)[-1] for seed in (1, 1, 2))
    assert one == same
    assert one.roll_rad != other.roll_rad


LEANING = PadState(
    north_m=5.0,
    east_m=-2.0,
    down_m=-1.2,
    vel_north_m_s=1.0,
    vel_east_m_s=0.5,
    heading_rad=0.7,
    deck_half_m=1.2,
    vel_down_m_s=0.2,
    roll_rad=0.1,
    pitch_rad=-0.06,
    heading_rate_rad_s=0.1,
    roll_rate_rad_s=0.2,
    pitch_rate_rad_s=-0.15,
)


def test_deck_axes_are_those_of_the_aerospace_angles():
    expected = rotation_from_euler(0.1, -0.06, 0.7)
    assert np.array(LEANING.axes).T == pytest.approx(expected)
    assert LEANING.tilt_rad == pytest.approx(math.acos(expected[2, 2]))


def test_deck_point_moves_with_its_velocity():
    """The velocity of a point of the deck against the difference of where it is."""
    dt, point = 1e-5, np.array([0.8, -0.5, 0.0])

    def at(k: int) -> np.ndarray:
        s, t = LEANING, k * dt
        turned = rotation_from_euler(
            s.roll_rad + t * s.roll_rate_rad_s, s.pitch_rad + t * s.pitch_rate_rad_s, s.heading_rad + 0.1 * t
        )
        origin = np.array([s.north_m, s.east_m, s.down_m]) + t * np.array([1.0, 0.5, 0.2])
        return origin + turned @ point

    velocity = (at(1) - at(-1)) / (2 * dt)
    assert LEANING.velocity_at(*at(0)) == pytest.approx(tuple(velocity), abs=1e-6)
    assert LEANING.on_deck_m(*at(0)) == pytest.approx(tuple(point), abs=1e-9)
    assert LEANING.surface_down_m(*at(0)[:2]) == pytest.approx(at(0)[2])


def test_vehicle_put_on_a_leaning_deck_comes_to_rest_on_it():
    """8 degrees is less than friction's angle (atan 0.7): it stands, tilted as the deck is."""
    deck = PadState(0.0, 0.0, -1.5, 0.0, 0.0, 0.3, 1.2, roll_rad=math.radians(8.0))
    plant = Plant()
    plant.body.d = -1.75
    for _ in range(1000):
        plant.step(STEP_S, (0.0, 0.0, 0.0), deck)
    assert plant.feet.on_deck == 4
    assert math.hypot(plant.body.vn, plant.body.ve, plant.body.vd) < 0.01
    cos_tilt = 1.0 - 2.0 * (plant.body.qx**2 + plant.body.qy**2)
    assert math.degrees(math.acos(cos_tilt)) == pytest.approx(8.0, abs=0.5)
    assert plant.crashed is None


def test_estimate_without_gnss_drifts_by_the_integral_of_its_own_velocity():
    body, estimator = RigidBody(), Estimator(RigidBody(), 3, gnss=False)
    travelled, farthest = 0.0, 0.0
    for _ in range(50_000):
        now = estimator.step(STEP_S, body)
        travelled += now.vn * STEP_S
        farthest = max(farthest, abs(now.n))
    assert now.n == pytest.approx(travelled, abs=1e-6)
    assert farthest > 0.5
