"""The vehicle at the instant of a frame: between two states, a little beyond the newest, and not farther."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from app.estimation.vehicle_history import VehicleHistory
from app.messages import VehicleState


def state(
    t_s: float, north_m: float = 0.0, speed_m_s: float = 0.0, yaw_deg: float = 0.0, **changes: Any
) -> VehicleState:
    half = math.radians(yaw_deg) / 2
    q = np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
    q = changes.pop("q_ned_from_body_wxyz", q)
    return VehicleState(t_s, np.array([north_m, 0.0, -3.0]), np.array([speed_m_s, 0.0, 0.0]), q, **changes)


def history(*states: VehicleState, length_s: float = 2.0) -> VehicleHistory:
    kept = VehicleHistory(length_s)
    for one in states:
        kept.add(one)
    return kept


def test_between_two_states_everything_is_interpolated():
    moment = history(state(10.0, 1.0, 2.0, 0.0), state(10.2, 2.0, 6.0, 40.0)).at(10.05)
    assert moment is not None and moment.state.t_capture_s == 10.05
    np.testing.assert_allclose(moment.state.pos_ned_m, [1.25, 0.0, -3.0])
    np.testing.assert_allclose(moment.state.vel_ned_m_s, [3.0, 0.0, 0.0])
    half = math.radians(10.0) / 2  # a quarter of 40 degrees
    np.testing.assert_allclose(moment.state.q_ned_from_body_wxyz, [math.cos(half), 0.0, 0.0, math.sin(half)])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_attitude_is_interpolated_the_short_way_whatever_the_sign_of_the_quaternion(sign):
    a, b = state(10.0, yaw_deg=-10.0), state(10.2, yaw_deg=10.0)
    b = VehicleState(b.t_capture_s, b.pos_ned_m, b.vel_ned_m_s, sign * b.q_ned_from_body_wxyz)
    moment = history(a, b).at(10.1)
    assert moment is not None
    np.testing.assert_allclose(np.abs(moment.state.q_ned_from_body_wxyz), [1.0, 0.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("t_s", "north_m"), [(10.0, 1.0), (10.1, 1.2), (10.099, 1.198)])
def test_at_a_state_and_a_little_beyond_the_newest_the_position_is_carried_on(t_s, north_m):
    moment = history(state(10.0, 1.0, 2.0)).at(t_s)
    assert moment is not None
    assert moment.state.pos_ned_m[0] == pytest.approx(north_m)


@pytest.mark.parametrize("t_s", [9.99, 10.11, 20.0])
def test_out_of_reach_is_nothing(t_s):
    assert history(state(10.0)).at(t_s) is None


def test_empty_history_is_nothing():
    assert history().at(10.0) is None


def test_gap_in_the_telemetry_is_not_interpolated_over():
    kept = history(state(10.0), state(10.5), state(10.6))
    assert kept.at(10.25) is None
    assert kept.at(10.55) is not None


def test_state_that_is_not_newer_is_ignored():
    moment = history(state(10.0, 1.0), state(10.0, 5.0), state(9.9, 7.0)).at(10.0)
    assert moment is not None and moment.state.pos_ned_m[0] == 1.0


def test_states_older_than_the_window_are_dropped():
    kept = history(*(state(10.0 + 0.1 * k) for k in range(31)), length_s=2.0)
    assert kept.at(10.9) is None
    assert kept.at(11.05) is not None


def test_reset_of_the_local_frame_empties_the_past():
    kept = history(state(10.0, 1.0), state(10.1, 1.0), state(10.2, 50.0, frame_resets=1))
    assert kept.at(10.1) is None
    moment = kept.at(10.2)
    assert moment is not None and moment.state.pos_ned_m[0] == 50.0


def test_travelled_is_the_integral_of_px4s_velocity_not_of_its_position():
    """0.1 s from 1 to 3 m/s and 0.2 s from 3 to 3 m/s: 0.2 m and 0.6 m; the position says something else."""
    kept = history(state(10.0, 0.0, 1.0), state(10.1, 0.5, 3.0), state(10.3, 0.9, 3.0))
    first, last, between = kept.at(10.0), kept.at(10.3), kept.at(10.2)
    assert first is not None and last is not None and between is not None
    assert last.travelled_ned_m[0] - first.travelled_ned_m[0] == pytest.approx(0.8)
    assert between.travelled_ned_m[0] - first.travelled_ned_m[0] == pytest.approx(0.5)


def test_angular_velocity_is_the_attitudes_rate_along_the_ned_axes():
    kept = history(*(state(10.0 + 0.02 * k, yaw_deg=30.0 * 0.02 * k) for k in range(20)))
    for t_s in (10.2, 10.38):  # in the middle, and at the newest state
        np.testing.assert_allclose(kept.turning_rad_s(t_s), [0.0, 0.0, math.radians(30.0)], atol=1e-4)


def test_angular_velocity_turns_with_the_body():
    """Pitching up at 20 degrees a second while heading east: about the south axis in ned."""
    states = []
    for k in range(20):
        half = math.radians(20.0 * 0.02 * k) / 2
        heading, pitch = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)), (math.cos(half), 0.0, math.sin(half), 0.0)
        a, b = heading, pitch
        q = (a[0] * b[0] - a[3] * b[3], -a[3] * b[2], a[0] * b[2], a[3] * b[0])
        states.append(state(10.0 + 0.02 * k, q_ned_from_body_wxyz=np.array(q)))
    np.testing.assert_allclose(history(*states).turning_rad_s(10.2), [-math.radians(20.0), 0.0, 0.0], atol=1e-4)


def test_angular_velocity_out_of_reach_is_nothing():
    assert history().turning_rad_s(10.0) is None
    assert history(state(10.0)).turning_rad_s(10.0) is None
