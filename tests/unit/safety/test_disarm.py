"""A forced disarm is allowed only if every single condition holds."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.messages import GuidanceStatus, PadTrack, VehicleState
from app.safety.disarm import may_force_disarm

NOW_S = 100.0


def vehicle(tilt_deg: float = 3.0, t_s: float = 99.99) -> VehicleState:
    half = math.radians(tilt_deg) / 2
    q = np.array([math.cos(half), 0.0, math.sin(half), 0.0])
    return VehicleState(t_s, np.zeros(3), np.zeros(3), q, armed=True)


def track(speed_m_s: float = 3.75) -> PadTrack:
    velocity = np.array([0.6 * speed_m_s, 0.8 * speed_m_s, 0.0])
    return PadTrack(99.0, np.zeros(3), velocity, np.eye(6), 0.0, 0.0, 99.0, 50)


def word(**changes: Any) -> GuidanceStatus:
    rests = GuidanceStatus(
        t_s=99.98,
        height_above_pad_m=0.1,
        relative_speed_m_s=0.1,
        committed=True,
        contact=True,
        contact_held_s=0.7,
    )
    return replace(rests, **changes)


def test_everything_at_rest_on_a_moving_pad_may_be_disarmed():
    assert may_force_disarm(vehicle(), track(), word(), NOW_S)


@pytest.mark.parametrize(
    "changes",
    [
        {"committed": False},
        {"contact": False},
        {"contact_held_s": 0.5},
        {"height_above_pad_m": None},
        {"height_above_pad_m": 0.5},
        {"height_above_pad_m": -0.35},
        {"height_above_pad_m": math.nan},
        {"relative_speed_m_s": None},
        {"relative_speed_m_s": 0.9},
        {"relative_speed_m_s": math.nan},
        {"contact_held_s": math.nan},
        {"t_s": math.nan},
        {"t_s": 99.6},
    ],
)
def test_one_condition_missing_forbids_it(changes):
    assert not may_force_disarm(vehicle(), track(), word(**changes), NOW_S)


def test_no_track_forbids_it():
    assert not may_force_disarm(vehicle(), None, word(), NOW_S)


@pytest.mark.parametrize(("tilt_deg", "allowed"), [(19.0, True), (21.0, False), (-21.0, False), (180.0, False)])
def test_tilt_forbids_it(tilt_deg, allowed):
    assert may_force_disarm(vehicle(tilt_deg), track(), word(), NOW_S) is allowed


@pytest.mark.parametrize("q", [np.full(4, math.nan), np.zeros(4)], ids=["nan", "zero"])
def test_attitude_that_is_no_rotation_forbids_it(q):
    assert not may_force_disarm(replace(vehicle(), q_ned_from_body_wxyz=q), track(), word(), NOW_S)


@pytest.mark.parametrize("t_s", [99.6, math.nan])
def test_vehicle_state_that_is_old_forbids_it(t_s):
    assert not may_force_disarm(vehicle(t_s=t_s), track(), word(), NOW_S)


@pytest.mark.parametrize(
    ("speed_m_s", "held_s", "allowed"),
    [(0.45, 1.0, False), (0.45, 6.9, False), (0.45, 7.1, True), (0.55, 0.7, True), (0.55, 0.5, False)],
)
def test_pad_at_rest_is_left_to_px4s_own_detector_first(speed_m_s, held_s, allowed):
    assert may_force_disarm(vehicle(), track(speed_m_s), word(contact_held_s=held_s), NOW_S) is allowed


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    committed=st.booleans(),
    contact=st.booleans(),
    held_s=st.floats(0.0, 20.0),
    height_m=st.one_of(st.none(), st.floats(-2.0, 5.0)),
    speed_m_s=st.one_of(st.none(), st.floats(0.0, 5.0)),
    tilt_deg=st.floats(-90.0, 90.0),
)
def test_forced_disarm_implies_contact_with_a_pad_under_the_vehicle(
    committed, contact, held_s, height_m, speed_m_s, tilt_deg
):
    seen = word(
        committed=committed,
        contact=contact,
        contact_held_s=held_s,
        height_above_pad_m=height_m,
        relative_speed_m_s=speed_m_s,
    )
    allowed = may_force_disarm(vehicle(tilt_deg), track(), seen, NOW_S)
    near = height_m is not None and abs(height_m) < 0.5 and speed_m_s is not None and speed_m_s < 1.0
    assert not allowed or (committed and contact and near and abs(tilt_deg) < 21.0)
