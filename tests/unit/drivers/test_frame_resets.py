"""Jumps of the local frame told from flight, by hand-made motions."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from app.frames import quaternion_from_rotation, rotation_from_euler
from drivers.autopilot.frame_resets import FrameResets


def fly(path: Callable[[float], tuple[list[float], list[float]]], rate_hz: float, seconds: float = 4.0) -> int:
    """Resets counted along a path: time to (position, velocity)."""
    resets = FrameResets()
    for k in range(int(seconds * rate_hz)):
        pos, vel = path(k / rate_hz)
        resets.see_position(k / rate_hz, np.array(pos), np.array(vel))
    return resets.count


def hard_turn(t: float) -> tuple[list[float], list[float]]:
    """A circle of 8 m/s at 8 m/s2: a radius of 8 m."""
    return [8 * math.cos(t), 8 * math.sin(t), -4.0], [-8 * math.sin(t), 8 * math.cos(t), 0.0]


def stepped(size_m: float) -> Callable[[float], tuple[list[float], list[float]]]:
    """North at 5 m/s, and a step to the east after two seconds."""
    return lambda t: ([5.0 * t, size_m if t >= 2.0 else 0.0, -4.0], [5.0, 0.0, 0.0])


@pytest.mark.parametrize("rate_hz", [2.0, 10.0, 100.0])
def test_position_of_a_hard_turn_is_no_reset(rate_hz: float) -> None:
    assert fly(hard_turn, rate_hz) == 0


@pytest.mark.parametrize(("size_m", "count"), [(0.2, 0), (0.5, 1), (-3.0, 1)])
def test_position_step_beyond_the_ordinary_correction_is_one_reset(size_m: float, count: int) -> None:
    assert fly(stepped(size_m), 100.0) == count


def test_position_at_the_same_time_again_is_no_reset() -> None:
    resets = FrameResets()
    resets.see_position(1.0, np.zeros(3), np.zeros(3))
    assert not resets.see_position(1.0, np.ones(3), np.zeros(3))


@pytest.mark.parametrize(("yaw_step_deg", "count"), [(0.0, 0), (5.0, 0), (15.0, 1), (-90.0, 1)])
def test_heading_step_beyond_the_turn_rate_is_one_reset(yaw_step_deg: float, count: int) -> None:
    resets = FrameResets()
    for k in range(200):
        # Turning at 90 degrees a second, banked by 20 degrees; the body rates of that turn by Euler's equations.
        rate, roll = math.radians(90.0), math.radians(20.0)
        yaw = rate * k * 0.01 + (math.radians(yaw_step_deg) if k >= 100 else 0.0)
        q = quaternion_from_rotation(rotation_from_euler(roll, 0.0, yaw))
        resets.see_attitude(k * 0.01, q, np.array([0.0, rate * math.sin(roll), rate * math.cos(roll)]))
    assert resets.count == count


def test_restart_of_the_autopilot_is_one_reset_and_compares_nothing_across_it() -> None:
    resets = FrameResets()
    resets.see_position(100.0, np.array([50.0, 0.0, 0.0]), np.zeros(3))
    resets.forget()
    assert not resets.see_position(1.0, np.zeros(3), np.zeros(3))
    assert resets.count == 1
