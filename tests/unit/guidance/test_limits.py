"""Speeds towards a point, shortened vectors and bounded steps, by numbers worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.guidance.limits import approach, closing_speed_m_s, limit_norm


@pytest.mark.parametrize(
    ("distance_m", "expected_m_s"),
    [
        (0.0, 0.0),
        (0.5, 0.5),  # v = k d
        (1.5, 1.5),  # the joint: a / k = 1.5 m/s at a / k^2 = 1.5 m
        (2.25, 2.1213203),  # sqrt(2 * 1.5 * (2.25 - 0.75)) = sqrt(4.5)
        (3.75, 3.0),  # sqrt(2 * 1.5 * 3) = 3
        (100.0, 4.0),  # the limit
    ],
)
def test_closing_speed_by_hand(distance_m, expected_m_s):
    assert closing_speed_m_s(distance_m, 1.0, 4.0, 1.5) == pytest.approx(expected_m_s)


@pytest.mark.parametrize("start_m", [1.0, 5.0, 20.0])
def test_closing_speed_followed_exactly_never_brakes_harder_than_it_says(start_m):
    distance_m, previous, dt = start_m, None, 1e-3
    hardest = 0.0
    while distance_m > 0.01:
        speed = closing_speed_m_s(distance_m, 0.8, 6.0, 1.5)
        hardest = hardest if previous is None else max(hardest, (previous - speed) / dt)
        previous, distance_m = speed, distance_m - speed * dt
    assert hardest <= 1.5 * 1.01


@given(st.floats(0.0, 500.0), st.floats(0.0, 500.0))
def test_closing_speed_grows_with_the_distance(a, b):
    near, far = sorted((a, b))
    assert closing_speed_m_s(near, 0.9, 3.0, 1.5) <= closing_speed_m_s(far, 0.9, 3.0, 1.5) + 1e-12


def test_limit_norm_shortens_three_four_five():
    np.testing.assert_allclose(limit_norm(np.array([3.0, 4.0]), 2.5), [1.5, 2.0])


def test_limit_norm_leaves_a_short_vector_alone():
    np.testing.assert_array_equal(limit_norm(np.array([0.3, -0.4, 0.0]), 0.5), [0.3, -0.4, 0.0])


# ------------------------------------------------------------------------------------------ acceleration and jerk
A, J, DT = 4.0, 30.0, 0.02


def follow(wanted, turns: int, velocity=(0.0, 0.0), acceleration=(0.0, 0.0), dt_s=DT) -> tuple[np.ndarray, np.ndarray]:
    """(turns + 1, 2) velocities and accelerations; `wanted` stands still, or is a function of the turn."""
    velocities, accelerations = [np.array(velocity)], [np.array(acceleration)]
    for k in range(turns):
        goal = np.array(wanted(k) if callable(wanted) else wanted)
        velocity_next, acceleration_next = approach(velocities[-1], accelerations[-1], goal, A, J, dt_s)
        velocities.append(velocity_next)
        accelerations.append(acceleration_next)
    return np.array(velocities), np.array(accelerations)


def test_approach_builds_its_acceleration_up_at_the_jerk_and_goes_on_at_the_limit():
    """30 m/s3 for 0.02 s is 0.6 m/s2 a turn; 4 m/s2 is reached in the seventh."""
    velocities, accelerations = follow((50.0, 0.0), 8)
    np.testing.assert_allclose(accelerations[1:, 0], [0.6, 1.2, 1.8, 2.4, 3.0, 3.6, 4.0, 4.0])
    np.testing.assert_allclose(velocities[:3, 0], [0.0, 0.012, 0.036])


def test_approach_takes_the_least_time_that_the_limits_leave():
    """3 m/s at 4 m/s2 and 30 m/s3: v / a + a / j = 0.883 s, give or take a turn."""
    velocities, _ = follow((0.0, 3.0), 60)
    arrived = int(np.flatnonzero(velocities[:, 1] >= 3.0 - 1e-9)[0])
    assert arrived * DT == pytest.approx(0.883, abs=DT)


@pytest.mark.parametrize("step_m_s", [0.001, 0.013, 0.05, 0.3, 0.5333, 1.0, 2.7, 8.0])
def test_approach_from_rest_arrives_stays_and_never_overshoots(step_m_s):
    direction = np.array([0.6, -0.8])
    velocities, accelerations = follow(step_m_s * direction, 200)
    along = velocities @ direction
    assert along.max() <= step_m_s + 1e-9
    assert np.diff(along).min() >= -1e-9
    np.testing.assert_allclose(velocities[-1], step_m_s * direction, atol=1e-9)
    np.testing.assert_allclose(accelerations[-1], 0.0, atol=1e-9)
    np.testing.assert_allclose(velocities @ [0.8, 0.6], 0.0, atol=1e-12)


@given(st.lists(st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0)), min_size=1, max_size=60))
def test_approach_of_anything_keeps_both_limits(wanted):
    velocities, accelerations = follow(lambda k: wanted[k], len(wanted))
    np.testing.assert_allclose(np.diff(velocities, axis=0), DT * accelerations[1:], atol=1e-9)
    assert np.linalg.norm(accelerations, axis=1).max() <= A + 1e-9
    assert np.linalg.norm(np.diff(accelerations, axis=0), axis=1).max() <= J * DT + 1e-9


def test_approach_with_an_acceleration_that_points_away_passes_by_no_more_than_the_jerk_takes():
    """At its goal with 2 m/s2: a^2 / 2j = 6.7 cm/s at most; then it comes back."""
    velocities, _ = follow((1.0, 0.0), 100, velocity=(1.0, 0.0), acceleration=(2.0, 0.0))
    assert velocities[:, 0].max() <= 1.0 + 0.067
    assert velocities[:, 0].min() >= 1.0 - 1e-9
    np.testing.assert_allclose(velocities[-1], [1.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("argument", ["velocity", "acceleration", "wanted"])
def test_approach_to_or_from_what_is_not_finite_is_not_a_number(bad, argument):
    """It must never pass for a velocity that is right already: the vehicle would fly on at its last one."""
    figures = {name: np.zeros(2) for name in ("velocity", "acceleration", "wanted")}
    figures[argument][0] = bad
    velocity, _ = approach(**figures, acceleration_max=3.0, jerk_max=30.0, dt_s=0.02)
    assert not np.isfinite(velocity).all()
