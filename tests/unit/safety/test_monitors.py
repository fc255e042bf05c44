"""Each hazard at its limit, and which of several is told."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.config import SafetyConfig
from app.messages import RESPONSES, Hazard, Response, VehicleState
from app.safety.monitors import judge

CONFIG = SafetyConfig(
    vehicle_state_stale_s=0.5,
    frames_stale_s=1.0,
    distance_from_home_max_m=300.0,
    height_max_m=30.0,
    tilt_max_deg=45.0,
    battery_min_fraction=0.15,
)
HOME = np.array([10.0, 20.0, 1.0])


def tilted(roll_deg: float) -> np.ndarray:
    half = math.radians(roll_deg) / 2
    return np.array([math.cos(half), math.sin(half), 0.0, 0.0])


def vehicle(**changes: Any) -> VehicleState:
    state = VehicleState(
        t_capture_s=100.0,
        pos_ned_m=np.array([10.0, 20.0, -4.0]),
        vel_ned_m_s=np.zeros(3),
        q_ned_from_body_wxyz=tilted(0.0),
        armed=True,
        local_position_ok=True,
        battery_fraction=0.8,
    )
    return replace(state, **changes)


def hazard(state: VehicleState | None, *, home: Any = HOME, frame_s: float | None = 100.0, now_s: float = 100.0) -> Any:
    verdict = judge(state, home, frame_s, now_s, CONFIG)
    return None if verdict is None else verdict.hazard


def test_nothing_wrong_is_no_verdict():
    assert hazard(vehicle()) is None


def test_no_vehicle_is_a_lost_link():
    assert hazard(None) is Hazard.LINK_LOST


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"connected": False}, Hazard.LINK_LOST),
        ({"t_capture_s": 99.51}, None),
        ({"t_capture_s": 99.49}, Hazard.VEHICLE_STATE_STALE),
        ({"local_position_ok": False}, Hazard.POSITION_LOST),
        ({"pos_ned_m": np.array([0.0, np.nan, 0.0])}, Hazard.POSITION_LOST),
        ({"vel_ned_m_s": np.array([0.0, 0.0, np.inf])}, Hazard.POSITION_LOST),
        ({"q_ned_from_body_wxyz": tilted(44.9)}, None),
        ({"q_ned_from_body_wxyz": tilted(-45.1)}, Hazard.TILT_EXCESSIVE),
        ({"q_ned_from_body_wxyz": tilted(180.0)}, Hazard.TILT_EXCESSIVE),
        ({"battery_fraction": 0.15}, None),
        ({"battery_fraction": 0.14}, Hazard.BATTERY_LOW),
        ({"battery_fraction": None}, None),
        ({"pos_ned_m": np.array([10.0 + 180.0, 20.0 + 239.9, 0.0])}, None),  # 3-4-5: 300 m
        ({"pos_ned_m": np.array([10.0 - 180.0, 20.0 - 240.1, 0.0])}, Hazard.TOO_FAR),
        ({"pos_ned_m": np.array([10.0, 20.0, -28.9])}, None),  # home is 1 m below the origin
        ({"pos_ned_m": np.array([10.0, 20.0, -29.1])}, Hazard.TOO_HIGH),
        ({"pos_ned_m": np.array([10.0, 20.0, 60.0])}, None),
    ],
)
def test_hazard_at_its_limit(changes, expected):
    assert hazard(vehicle(**changes)) is expected


@pytest.mark.parametrize(
    ("frame_s", "expected"), [(99.1, None), (98.9, Hazard.FRAMES_STALE), (None, Hazard.FRAMES_STALE)]
)
def test_frames_that_stop_are_a_hazard(frame_s, expected):
    assert hazard(vehicle(), frame_s=frame_s) is expected


def test_distance_and_height_without_a_home_are_no_hazard():
    assert hazard(vehicle(pos_ned_m=np.array([9e3, 9e3, -9e3])), home=None) is None


WRONG: dict[Hazard, dict[str, Any]] = {
    Hazard.LINK_LOST: {"connected": False},
    Hazard.VEHICLE_STATE_STALE: {"t_capture_s": 90.0},
    Hazard.POSITION_LOST: {"local_position_ok": False},
    Hazard.TILT_EXCESSIVE: {"q_ned_from_body_wxyz": tilted(90.0)},
    Hazard.BATTERY_LOW: {"battery_fraction": 0.01},
    Hazard.TOO_FAR: {"pos_ned_m": np.array([999.0, 0.0, -99.0])},
}


@pytest.mark.parametrize("first", list(WRONG))
def test_gravest_of_several_hazards_is_told(first):
    """Hazard lists them gravest first; everything from `first` on is wrong at once."""
    order = list(Hazard)
    changes: dict[str, Any] = {}
    for graver in [h for h in order[order.index(first) :] if h in WRONG]:
        changes.update(WRONG[graver])
    assert hazard(vehicle(**changes), frame_s=None) is first


@pytest.mark.parametrize("kind", list(Hazard))
def test_every_hazard_has_a_response(kind):
    assert isinstance(RESPONSES[kind], Response)


@pytest.mark.parametrize("changes", [*WRONG.values(), {"pos_ned_m": np.array([0.0, 0.0, -1e6])}, {"t_capture_s": -1e7}])
def test_words_of_a_verdict_fit_the_phone(changes):
    verdict = judge(vehicle(**changes), HOME, 100.0, 100.0, CONFIG)
    assert verdict is not None and len(verdict.detail) <= 40 and verdict.detail.isascii()
