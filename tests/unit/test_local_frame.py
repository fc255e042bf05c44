"""Jumps of PX4's local frame, by hand."""

from __future__ import annotations

import numpy as np

from app.frames import Array
from app.local_frame import FrameJumps
from app.messages import VehicleState


def state(t_s: float, pos: tuple[float, float, float], resets: int, north_m_s: float = 0.0) -> VehicleState:
    velocity = np.array([north_m_s, 0.0, 0.0])
    return VehicleState(t_s, np.array(pos), velocity, np.array([1.0, 0.0, 0.0, 0.0]), frame_resets=resets)


def seen(*states: VehicleState) -> FrameJumps:
    jumps = FrameJumps()
    for each in states:
        jumps = jumps.see(each)
    return jumps


def same(found: Array, *wanted: float) -> bool:
    return bool(np.allclose(found, wanted, atol=1e-12))


def test_what_the_vehicle_flew_meanwhile_is_no_part_of_a_jump():
    jumps = seen(state(1.0, (0.0, 0.0, 0.0), 0, north_m_s=2.0), state(1.5, (4.0, 0.0, -2.0), 1))
    assert same(jumps.since(1.0), 3.0, 0.0, -2.0)


def test_motion_without_a_reset_is_no_jump():
    assert same(seen(state(1.0, (0.0, 0.0, 0.0), 3), state(1.1, (9.0, 0.0, 0.0), 3)).since(0.0), 0.0, 0.0, 0.0)


def test_each_place_is_carried_over_the_jumps_after_it_and_no_others():
    jumps = seen(
        state(1.0, (0.0, 0.0, 0.0), 0),
        state(2.0, (3.0, 0.0, 0.0), 1),
        state(2.1, (3.0, 0.0, 0.5), 2),
        state(3.0, (3.0, 0.0, 0.5), 2),
    )
    assert same(jumps.since(1.9), 3.0, 0.0, 0.5)
    assert same(jumps.since(2.0), 0.0, 0.0, 0.5)  # worked out from the state that had jumped
    assert same(jumps.since(2.1), 0.0, 0.0, 0.0)


def test_jumps_are_forgotten_after_a_minute():
    first = state(1.0, (0.0, 0.0, 0.0), 0), state(2.0, (3.0, 0.0, 0.0), 1)
    assert same(seen(*first, state(61.9, (3.0, 0.0, 0.0), 1)).since(1.0), 3.0, 0.0, 0.0)
    assert same(seen(*first, state(62.1, (3.0, 0.0, 0.0), 1)).since(1.0), 0.0, 0.0, 0.0)
