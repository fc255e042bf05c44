"""Speeds towards a point, shortened vectors and bounded steps, by numbers worked by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.guidance.limits import closing_speed_m_s, limit_norm, slew


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


def test_slew_steps_by_rate_times_time_in_the_direction_wanted():
    np.testing.assert_allclose(slew(np.zeros(2), np.array([3.0, 4.0]), 5.0, 0.1), [0.3, 0.4])


def test_slew_arrives_and_stays():
    np.testing.assert_allclose(slew(np.array([1.0, 0.0]), np.array([1.1, 0.0]), 3.0, 0.1), [1.1, 0.0])
