"""The expanding square: its corners by hand, and that nothing inside it stays unseen."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from app.guidance.search import SearchPattern, expanding_square_m


def test_corners_of_three_metres_spacing_by_hand():
    """Legs of 3, 3, 6, 6, 9, 9 m: north, east, south, west, north, east; radius 6 m is reached after the fifth."""
    expected = [(0, 0), (3, 0), (3, 3), (-3, 3), (-3, -3), (6, -3)]
    np.testing.assert_allclose(expanding_square_m(3.0, 6.0), expected)


@pytest.mark.parametrize(("spacing_m", "radius_m"), [(3.0, 15.0), (2.0, 9.0), (5.0, 30.0)])
def test_legs_pass_every_point_inside_by_half_the_spacing(spacing_m, radius_m):
    corners = expanding_square_m(spacing_m, radius_m)
    ends = [(a, b, max(1, int(np.linalg.norm(b - a) / 0.1))) for a, b in itertools.pairwise(corners)]
    flown = np.concatenate([a + np.linspace(0.0, 1.0, n + 1)[:, None] * (b - a) for a, b, n in ends])
    inside = radius_m - spacing_m
    grid = np.stack(np.meshgrid(np.linspace(-inside, inside, 41), np.linspace(-inside, inside, 41)), -1).reshape(-1, 2)
    nearest = np.array([np.abs(flown - point).max(axis=1).min() for point in grid])
    assert nearest.max() <= spacing_m / 2 + 0.11


def test_pattern_flown_by_a_perfect_vehicle_visits_every_corner_and_ends():
    anchor = np.array([100.0, -50.0, 2.0])
    corners = expanding_square_m(3.0, 9.0)
    pattern = SearchPattern(anchor, corners)
    pos, nearest, fastest, turns = anchor.copy(), np.full(len(corners), np.inf), 0.0, 0
    while not pattern.finished and turns < 20000:
        velocity = pattern.velocity_ne_m_s(pos, 2.0, 1.5)
        pos[:2] += 0.02 * velocity
        nearest = np.minimum(nearest, np.linalg.norm(anchor[:2] + corners - pos[:2], axis=1))
        fastest, turns = max(fastest, float(np.linalg.norm(velocity))), turns + 1
    assert pattern.finished
    assert nearest.max() <= 0.5
    assert fastest == pytest.approx(2.0)


def test_pattern_that_is_finished_stands_still():
    pattern = SearchPattern(np.zeros(3), np.zeros((1, 2)))
    np.testing.assert_array_equal(pattern.velocity_ne_m_s(np.array([0.1, 0.1, -3.0]), 2.0, 1.5), [0.0, 0.0])
    assert pattern.finished
