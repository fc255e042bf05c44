"""Every setpoint keeps within its envelope, whatever goal, track, vehicle or clock made it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.config import GuidanceConfig, SafetyConfig
from app.guidance.envelope import Envelope, Surroundings, bounded, envelope_of
from app.guidance.velocity import VelocityController
from app.messages import Goal, GoalKind, PadTrack, Setpoint, VehicleState
from app.wiring import CONFIGS, load_rig

ENVELOPE = Envelope(
    speed_max_m_s=8.0, climb_max_m_s=3.0, sink_max_m_s=3.5, acceleration_max_m_s2=6.0, floor_m=2.5, ceiling_m=30.0
)
HIGH_OVER_PAD = Surroundings(over_home_m=10.0, over_pad_m=8.0)


def setpoint(vel=(0.0, 0.0, 0.0), acc=(0.0, 0.0, 0.0), yaw_rad: float = 0.0) -> Setpoint:
    return Setpoint(100.0, np.array(vel, dtype=float), np.array(acc, dtype=float), yaw_rad)


def sent(made: Setpoint, place: Surroundings = HIGH_OVER_PAD) -> Setpoint:
    found = bounded(made, ENVELOPE, place)
    assert found is not None
    return found


def vertical_m_s(down_m_s: float, place: Surroundings) -> float:
    return float(sent(setpoint((0.0, 0.0, down_m_s)), place).vel_ned_m_s[2])


def test_setpoint_within_its_envelope_is_left_alone():
    made = setpoint((3.0, -4.0, 0.8), (1.0, 2.0, 0.0), 1.0)
    found = sent(made)
    np.testing.assert_array_equal(found.vel_ned_m_s, made.vel_ned_m_s)
    np.testing.assert_array_equal(found.acc_ned_m_s2, made.acc_ned_m_s2)
    assert found.yaw_ned_rad == pytest.approx(1.0)


def test_horizontal_velocity_is_shortened_and_keeps_its_direction():
    np.testing.assert_allclose(sent(setpoint((30.0, -40.0, 0.0))).vel_ned_m_s, [4.8, -6.4, 0.0])


@pytest.mark.parametrize(("down_m_s", "expected"), [(-9.0, -3.0), (9.0, 3.5)])
def test_climb_and_sink_have_limits_of_their_own(down_m_s, expected):
    assert vertical_m_s(down_m_s, HIGH_OVER_PAD) == expected


def test_feed_forward_is_limited():
    np.testing.assert_allclose(sent(setpoint(acc=(0.0, 60.0, 60.0))).acc_ned_m_s2, [0.0, 6.0, 6.0])


def test_heading_is_wrapped():
    assert sent(setpoint(yaw_rad=4.0)).yaw_ned_rad == pytest.approx(4.0 - 2.0 * math.pi)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(8))
def test_figure_that_is_not_finite_yields_no_setpoint(bad, place):
    figures = [100.0, *[0.0] * 7]
    figures[place] = bad
    made = Setpoint(figures[0], np.array(figures[1:4]), np.array(figures[4:7]), figures[7])
    assert bounded(made, ENVELOPE, HIGH_OVER_PAD) is None


@pytest.mark.parametrize(
    ("over_home_m", "most_m_s"),
    # Eight tenths of the distance to the floor at 2.5 m, a second.
    [(10.0, 3.5), (4.5, 1.6), (2.6, 0.08), (2.5, 0.0), (1.0, 0.0), (-5.0, 0.0), (math.nan, 0.0), (None, 0.0)],
)
def test_nothing_sinks_below_the_floor_without_a_usable_track(over_home_m, most_m_s):
    assert vertical_m_s(9.0, Surroundings(over_home_m)) == pytest.approx(most_m_s)
    assert vertical_m_s(-1.0, Surroundings(over_home_m)) == pytest.approx(0.0 if over_home_m != over_home_m else -1.0)


@pytest.mark.parametrize(
    ("over_home_m", "over_pad_m", "rests", "most_m_s"),
    [
        pytest.param(10.0, 4.0, False, 3.5, id="high"),
        pytest.param(10.0, 2.9, False, 1.8, id="near the pad"),
        pytest.param(2.9, 4.0, False, 1.8, id="near home, over a pad in a pit"),
        pytest.param(None, 2.9, False, 1.8, id="home unknown"),
        pytest.param(1.5, 0.1, True, 3.5, id="resting on the pad, pressed onto it"),
        pytest.param(math.nan, 2.9, False, 1.8, id="home not a number"),
    ],
)
def test_sink_near_the_ground_is_slower(over_home_m, over_pad_m, rests, most_m_s):
    assert vertical_m_s(9.0, Surroundings(over_home_m, over_pad_m, rests)) == most_m_s


@pytest.mark.parametrize(
    ("over_home_m", "most_m_s"), [(10.0, 3.0), (29.0, 0.8), (30.0, 0.0), (40.0, 0.0), (math.nan, 0.0), (None, 3.0)]
)
@pytest.mark.parametrize("over_pad_m", [None, 2.0])
def test_nothing_climbs_above_the_ceiling(over_home_m, over_pad_m, most_m_s):
    assert vertical_m_s(-9.0, Surroundings(over_home_m, over_pad_m)) == pytest.approx(-most_m_s)


def test_envelope_of_the_rig_that_ships_lets_a_heaving_deck_be_followed():
    """8 m/s, 1 m/s of climb and 1.5 m/s of press as configured; a deck adds 2 m/s to the vertical ones."""
    assert envelope_of(load_rig(CONFIGS / "simulator.toml").config) == Envelope(8.0, 3.0, 3.5, 6.0, 2.5, 30.0)


# -------------------------------------------------------------------------------------- whatever any controller returns
ANY = st.floats(allow_nan=True, allow_infinity=True)
ANY_3 = st.tuples(ANY, ANY, ANY).map(np.array)
HEIGHT = st.one_of(st.none(), ANY)


def is_within(found: Setpoint, place: Surroundings) -> bool:
    figures = [*found.vel_ned_m_s, *found.acc_ned_m_s2, found.yaw_ned_rad]
    down_m_s = float(found.vel_ned_m_s[2])
    low = place.over_home_m is None or not place.over_home_m > ENVELOPE.floor_m
    high = place.over_home_m is not None and not place.over_home_m < ENVELOPE.ceiling_m
    return bool(
        np.isfinite(figures).all()
        and math.hypot(*found.vel_ned_m_s[:2]) <= 8.0 + 1e-9
        and -3.0 <= down_m_s <= 3.5
        and math.hypot(*found.acc_ned_m_s2[:2]) <= 6.0 + 1e-9
        and abs(found.acc_ned_m_s2[2]) <= 6.0
        and abs(found.yaw_ned_rad) <= math.pi
        and not (place.over_pad_m is None and low and down_m_s > 0.0)
        and not (high and down_m_s < 0.0)
    )


@settings(max_examples=300, deadline=None, derandomize=True)
@given(t_s=ANY, vel=ANY_3, acc=ANY_3, yaw_rad=ANY, over_home_m=HEIGHT, over_pad_m=HEIGHT, rests=st.booleans())
def test_no_setpoint_leaves_the_envelope(t_s, vel, acc, yaw_rad, over_home_m, over_pad_m, rests):
    place = Surroundings(over_home_m, over_pad_m, rests)
    found = bounded(Setpoint(t_s, vel, acc, yaw_rad), ENVELOPE, place)
    assert found is None or is_within(found, place)


OFTEN_SANE = st.one_of(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-300.0, 300.0), ANY)
PLACE = st.one_of(st.tuples(*[st.floats(-9.0, 9.0)] * 3), st.tuples(*[OFTEN_SANE] * 3)).map(np.array)
TURN = st.tuples(
    st.sampled_from(list(GoalKind)),
    st.integers(0, 2),
    OFTEN_SANE,
    PLACE,
    PLACE,
    PLACE,
    PLACE,
    st.floats(-4.0, 4.0),
    st.one_of(st.none(), OFTEN_SANE),
    st.sampled_from([0.0, 0.02, 0.02, 0.3, 5.0]),
)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(turns=st.lists(TURN, min_size=1, max_size=8), anchor=PLACE, drift=st.tuples(OFTEN_SANE, OFTEN_SANE))
def test_no_goal_track_or_vehicle_yields_a_setpoint_outside_of_the_envelope(turns, anchor, drift):
    """Through the velocity controller, turn after turn, with what it remembers."""
    steering, now_s = VelocityController(GuidanceConfig(), SafetyConfig()), 100.0
    for kind, number, height_m, pad_pos, pad_vel, pos, vel, turn_rad_s, over_home_m, dt_s in turns:
        now_s += dt_s
        goal = Goal(kind, height_m, anchor, number, drift)
        track = PadTrack(now_s, pad_pos, pad_vel, np.eye(6), turn_rad_s, 0.0, now_s, 99, turn_rate_rad_s=turn_rad_s)
        half = turn_rad_s / 2
        q = np.array([math.cos(half), math.sin(half), 0.0, 0.0])
        with np.errstate(all="ignore"):
            made, status = steering.step(goal, track, VehicleState(now_s, pos, vel, q, armed=True), now_s)
        place = Surroundings(over_home_m, status.height_above_pad_m)
        found = None if made is None else bounded(made, ENVELOPE, place)
        assert found is None or is_within(found, place)
