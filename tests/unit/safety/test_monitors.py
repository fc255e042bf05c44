"""Each hazard at its limit, and which of several is told."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.config import SafetyConfig
from app.messages import RESPONSES, CameraStatus, Hazard, PadTrack, Response, TrackCheck, VehicleState
from app.safety.monitors import SafetyInputs, TrackRestarts, judge

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
    verdicts = judge(SafetyInputs(state, home, frame_s), now_s, CONFIG)
    return verdicts[0].hazard if verdicts else None


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
        ({"q_ned_from_body_wxyz": tilted(32.9)}, None),
        ({"q_ned_from_body_wxyz": tilted(44.9)}, Hazard.WIND_EXCESSIVE),
        ({"q_ned_from_body_wxyz": tilted(-45.1)}, Hazard.TILT_EXCESSIVE),
        ({"q_ned_from_body_wxyz": tilted(180.0)}, Hazard.TILT_EXCESSIVE),
        ({"battery_fraction": 0.15}, None),
        ({"battery_fraction": 0.14}, Hazard.BATTERY_LOW),
        ({"battery_fraction": None}, Hazard.BATTERY_UNKNOWN),
        ({"battery_fraction": math.nan}, Hazard.BATTERY_UNKNOWN),
        ({"battery_age_s": 2.9}, None),
        ({"battery_age_s": 3.1}, Hazard.BATTERY_UNKNOWN),
        ({"mode_age_s": 1.4}, None),
        ({"mode_age_s": 1.6}, Hazard.MODE_UNKNOWN),
        ({"armed_age_s": 1.6}, Hazard.MODE_UNKNOWN),
        ({"mode_age_s": math.inf}, Hazard.MODE_UNKNOWN),
        ({"estimator_age_s": 3.1}, Hazard.POSITION_LOST),
        ({"t_capture_s": math.nan}, Hazard.VEHICLE_STATE_STALE),
        ({"q_ned_from_body_wxyz": np.full(4, math.nan)}, Hazard.TILT_EXCESSIVE),
        ({"q_ned_from_body_wxyz": np.zeros(4)}, Hazard.TILT_EXCESSIVE),
        ({"mode_age_s": math.nan}, Hazard.MODE_UNKNOWN),
        ({"armed_age_s": math.nan}, Hazard.MODE_UNKNOWN),
        ({"estimator_age_s": math.nan}, Hazard.POSITION_LOST),
        ({"battery_age_s": math.nan}, Hazard.BATTERY_UNKNOWN),
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


@pytest.mark.parametrize("frame_s", [math.nan, 100.0])
@pytest.mark.parametrize("arrived_s", [math.nan, None])
def test_frames_whose_times_are_not_known_are_a_hazard(frame_s, arrived_s):
    seen = SafetyInputs(vehicle(), HOME, frame_s, CameraStatus(100.0, new_frame_s=arrived_s))
    assert [verdict.hazard for verdict in judge(seen, 100.0, CONFIG)] == [Hazard.FRAMES_STALE]


@pytest.mark.parametrize(
    ("home", "expected"),
    [(np.array([np.nan, 20.0, 1.0]), Hazard.TOO_FAR), (np.array([10.0, 20.0, np.nan]), Hazard.TOO_HIGH)],
)
def test_home_that_is_not_a_number_is_a_hazard(home, expected):
    assert hazard(vehicle(), home=home) is expected


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
    verdicts = judge(SafetyInputs(vehicle(**changes), HOME, 100.0), 100.0, CONFIG)
    assert verdicts and all(len(v.detail) <= 40 and v.detail.isascii() for v in verdicts)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"estimator_test_ratio": 0.9}, []),
        ({"estimator_test_ratio": 1.1}, [Hazard.ESTIMATOR_BAD]),
        ({"estimator_test_ratio": math.nan}, [Hazard.ESTIMATOR_BAD]),
        ({"gnss_glitch": True}, [Hazard.ESTIMATOR_BAD]),
        ({"q_ned_from_body_wxyz": tilted(34.0)}, [Hazard.WIND_EXCESSIVE]),  # 45 deg less 12 of reserve
    ],
)
def test_estimator_and_wind_at_their_limits(changes, expected):
    assert [v.hazard for v in judge(SafetyInputs(vehicle(**changes), HOME, 100.0), 100.0, CONFIG)] == expected


# An L about home: 40 m to the north, 10 m wide, and a foot of 30 m to the east.
FENCE = ((-5.0, -5.0), (40.0, -5.0), (40.0, 5.0), (5.0, 5.0), (5.0, 30.0), (-5.0, 30.0))


@pytest.mark.parametrize(
    ("north", "east", "outside"),
    [
        (0.0, 0.0, False),
        (39.0, 4.0, False),
        (4.0, 29.0, False),
        (20.0, 20.0, True),
        (41.0, 0.0, True),
        (0.0, -6.0, True),
    ],
)
def test_fence_that_is_left_is_a_hazard(north, east, outside):
    config = SafetyConfig(fence_ne_m=FENCE)
    state = vehicle(pos_ned_m=HOME + np.array([north, east, -4.0]))
    hazards = [v.hazard for v in judge(SafetyInputs(state, HOME, 100.0), 100.0, config)]
    assert hazards == ([Hazard.FENCE_LEFT] if outside else [])


@pytest.mark.parametrize("fence", [((0.0, 0.0), (1.0, 1.0)), ((10.0, 10.0), (20.0, 10.0), (20.0, 20.0))])
def test_fence_without_area_or_without_home_is_refused(fence):
    with pytest.raises(ValueError, match="fence_ne_m"):
        SafetyConfig(fence_ne_m=fence)


TRACK = PadTrack(100.0, np.zeros(3), np.zeros(3), np.eye(6), 0.0, 0.0, 100.0, 20)


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        ({"camera": CameraStatus(100.0, 100.0)}, None),
        ({"camera": CameraStatus(100.0, 98.9)}, Hazard.FRAMES_STALE),  # times that lie ahead hide nothing
        ({"camera": CameraStatus(100.0, 100.0, frozen_s=0.3)}, Hazard.FRAMES_FROZEN),
        ({"camera": CameraStatus(100.0, 100.0, frozen_s=0.1)}, None),
        ({"camera": CameraStatus(100.0, 100.0, image_fault="black")}, Hazard.FRAMES_UNUSABLE),
        ({"camera": CameraStatus(100.0, 100.0, time_fault="frame times 60.0 s ahead")}, Hazard.CAMERA_TIME_WRONG),
        ({"track": replace(TRACK, delay_at_limit=True, delay_s=0.1)}, Hazard.CAMERA_TIME_WRONG),
        ({"track_restarts_lately": 2}, None),
        ({"track_restarts_lately": 3}, Hazard.CAMERA_TIME_WRONG),
        ({"track_check": TrackCheck(100.0, 0.1)}, None),
        ({"track_check": TrackCheck(100.0, 1.0, "camera repeats an image", 99.0)}, Hazard.PAD_COPIES_VEHICLE),
    ],
)
def test_camera_and_track_that_can_not_be_believed_are_hazards(seen, expected):
    verdicts = judge(SafetyInputs(vehicle(), HOME, 160.0, **seen), 100.0, CONFIG)
    assert [v.hazard for v in verdicts] == ([] if expected is None else [expected])


def test_unknown_battery_is_only_told_where_the_configuration_says_so():
    config = CONFIG.model_copy(update={"battery_unknown_action": "warn"})
    [verdict] = judge(SafetyInputs(vehicle(battery_fraction=None), HOME, 100.0), 100.0, config)
    assert verdict.hazard is Hazard.BATTERY_UNKNOWN and verdict.response is Response.WARN


def test_track_restarts_of_the_last_ten_seconds_are_counted():
    memory = TrackRestarts()
    for now_s, restarts in ((0.0, 1), (4.0, 2), (9.0, 4)):
        memory = memory.see(replace(TRACK, restarts=restarts), now_s)
    assert len(memory.times_s) == 4
    assert len(memory.see(None, 13.0).times_s) == 3  # that of 0 s is over 10 s ago
    assert len(memory.see(None, 18.9).times_s) == 2
