"""Gusts told from the vehicle's own doing: flights worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.guidance.gusts import Gusts, step_gusts, thrust_ne_m_s2

G, DT_S = 9.80665, 0.02


def pitched(nose_up_deg: float, yaw_deg: float = 0.0) -> np.ndarray:
    """w x y z of a vehicle that is turned to a heading and then leans back."""
    half, turn = math.radians(nose_up_deg) / 2, math.radians(yaw_deg) / 2
    c, s, ct, st = math.cos(half), math.sin(half), math.cos(turn), math.sin(turn)
    return np.array([ct * c, -st * s, ct * s, st * c])


def fly(q, acceleration_m_s2: float, seconds: float, memory: Gusts | None = None, from_s: float = 0.0) -> Gusts:
    """A vehicle of one attitude that speeds up to the north, for so long."""
    for k in range(round(seconds / DT_S) + 1):
        speed = acceleration_m_s2 * k * DT_S
        memory = step_gusts(memory, q, np.array([speed, 0.0]), from_s + k * DT_S)
    assert memory is not None
    return memory


@pytest.mark.parametrize(
    ("q", "expected"),
    [(pitched(10.0), (-G * math.tan(math.radians(10.0)), 0.0)), (pitched(-10.0, 90.0), (0.0, G * 0.1763270))],
)
def test_thrust_of_a_vehicle_that_leans_accelerates_it_to_where_it_leans(q, expected):
    """Nose up pulls back; nose down flies to where the nose points, east at a heading of 90 degrees."""
    np.testing.assert_allclose(thrust_ne_m_s2(q), expected, atol=1e-6)


def test_vehicle_that_speeds_up_because_it_leans_feels_no_gust():
    q = pitched(-10.0)
    memory = fly(q, G * math.tan(math.radians(10.0)), 2.0, Gusts(0.0, np.zeros(2), np.zeros(2), np.zeros(2)))
    np.testing.assert_allclose(memory.push_ne_m_s2, 0.0, atol=1e-9)


def test_wind_that_is_leant_against_from_the_first_is_known_and_is_no_gust():
    """Nose down 15 degrees, at rest: the air pushes back with g tan(15 deg)."""
    memory = fly(pitched(-15.0), 0.0, 3.0)
    np.testing.assert_allclose(memory.push_ne_m_s2, [-G * math.tan(math.radians(15.0)), 0.0], atol=1e-6)
    np.testing.assert_allclose(memory.gust_ne_m_s2, 0.0, atol=1e-6)


@pytest.mark.parametrize(("after_s", "share"), [(0.2, 0.632), (0.6, 0.95)])
def test_gust_on_a_level_vehicle_is_found_within_fractions_of_a_second(after_s, share):
    """1 m/s2 that begins at once: 1 - exp(-t / 0.2 s) of it; less than 10% of it is taken for lasting by then."""
    start = Gusts(0.0, np.zeros(2), np.zeros(2), np.zeros(2))
    memory = fly(pitched(0.0), 1.0, after_s, start)
    assert memory.push_ne_m_s2[0] == pytest.approx(share, abs=0.04)
    assert memory.gust_ne_m_s2[0] == pytest.approx(share, abs=0.12)
    assert memory.push_ne_m_s2[1] == 0.0


def test_push_that_lasts_is_left_to_px4():
    """exp(-25 s / 5 s) of it is left."""
    memory = fly(pitched(0.0), 1.0, 25.0, Gusts(0.0, np.zeros(2), np.zeros(2), np.zeros(2)))
    assert memory.push_ne_m_s2[0] == pytest.approx(1.0, abs=0.01)
    assert abs(memory.gust_ne_m_s2[0]) < 0.02


@pytest.mark.parametrize("t_s", [1.5, 0.5])
def test_state_after_a_gap_or_from_the_past_begins_anew(t_s):
    memory = fly(pitched(0.0), 1.0, 1.0)
    anew = step_gusts(memory, pitched(0.0), np.array([7.0, 0.0]), t_s)
    np.testing.assert_array_equal(anew.gust_ne_m_s2, 0.0)
    np.testing.assert_allclose(anew.push_ne_m_s2, 0.0, atol=1e-9)


def test_state_that_was_seen_before_changes_nothing():
    memory = fly(pitched(0.0), 1.0, 1.0)
    assert step_gusts(memory, pitched(5.0), np.array([9.0, 0.0]), memory.t_s) is memory
