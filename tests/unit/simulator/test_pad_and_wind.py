"""The pad's motion by hand, the wind by its statistics."""

from __future__ import annotations

import math
import statistics

import pytest

from app.config import PadMotionConfig
from drivers.simulator.pad import Pad, PadState
from drivers.simulator.wind import GaussMarkov, Wind


def test_pad_at_rest_stays_where_it_is() -> None:
    pad = Pad(PadMotionConfig(north_m=3.0, east_m=-2.0, height_m=1.5))
    for _ in range(100):
        pad.step(0.1, 5.0)
    assert (pad.state.north_m, pad.state.east_m, pad.state.down_m) == (3.0, -2.0, -1.5)


def test_pad_with_a_speed_waits_for_the_vehicle_to_fly() -> None:
    pad = Pad(PadMotionConfig(speed_m_s=2.0, start_after_s=3.0))
    for _ in range(100):
        pad.step(0.1, 0.5)
    assert pad.state.north_m == 3.0
    for _ in range(29):
        pad.step(0.1, 2.0)
    assert pad.state.vel_north_m_s == 0.0


def test_pad_that_drives_east_accelerates_and_then_keeps_its_speed() -> None:
    pad = Pad(PadMotionConfig(north_m=0.0, east_m=0.0, speed_m_s=3.0, acceleration_m_s2=1.5, heading_deg=90.0))
    pad.step(0.004, 2.0)
    for _ in range(1250):
        pad.step(0.004, 2.0)
    # 2 s to 3 m/s over 3 m, then 3 s at 3 m/s.
    assert pad.state.east_m == pytest.approx(3.0 + 9.0, abs=0.02)
    assert pad.state.north_m == pytest.approx(0.0, abs=1e-9)
    assert pad.state.vel_east_m_s == pytest.approx(3.0)


def test_pad_offset_is_told_in_its_own_axes() -> None:
    state = PadState(1.0, 1.0, 0.0, 0.0, 0.0, math.radians(90.0), 0.6)
    # A heading of east: what is north of it lies to its left.
    forward, right = state.offset_m(3.0, 1.5)
    assert (forward, right) == (pytest.approx(0.5), pytest.approx(-2.0))


def test_gauss_markov_has_its_deviation_and_its_correlation() -> None:
    import random

    process = GaussMarkov(2.0, 0.5, random.Random(3))
    values = [process.step(0.01) for _ in range(200_000)]
    assert statistics.pstdev(values) == pytest.approx(2.0, rel=0.05)
    lagged = statistics.fmean(a * b for a, b in zip(values, values[50:], strict=False))
    assert lagged / 4.0 == pytest.approx(math.exp(-1.0), abs=0.05)


def test_wind_from_the_west_blows_east_with_gusts_of_its_deviation() -> None:
    wind = Wind(3.0, 270.0, 0.8, seed=5)
    blown = [wind.step(0.01) for _ in range(200_000)]
    assert statistics.fmean(b[1] for b in blown) == pytest.approx(3.0, abs=0.1)
    assert statistics.fmean(b[0] for b in blown) == pytest.approx(0.0, abs=0.1)
    assert statistics.pstdev(b[0] for b in blown) == pytest.approx(0.8, rel=0.1)


def test_wind_of_the_same_seed_is_the_same_wind() -> None:
    one, two, other = (Wind(3.0, 0.0, 1.0, seed) for seed in (7, 7, 8))
    a, b, c = ([w.step(0.004) for _ in range(500)] for w in (one, two, other))
    assert a == b
    assert a != c
