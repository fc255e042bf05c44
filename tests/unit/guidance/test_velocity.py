"""The velocity controller, turn by turn: limits, stale tracks, memory, the frame's jumps, yaw."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.config import GuidanceConfig, SafetyConfig
from app.guidance.velocity import VelocityController
from app.messages import Goal, GoalKind, GuidanceStatus, PadTrack, Setpoint, VehicleState

CONFIG = GuidanceConfig(
    acceleration_max_m_s2=3.0,
    jerk_max_m_s3=30.0,
    speed_max_m_s=8.0,
    closing_speed_max_m_s=3.0,
    touchdown_speed_m_s=0.6,
    climb_speed_m_s=1.0,
    yaw_rate_max_deg_s=45.0,
    coast_s=4.0,
)
SAFETY = SafetyConfig(track_stale_s=0.5)
DT_S = 0.02
FOLLOWING = [GoalKind.HOVER, GoalKind.TRACK, GoalKind.LAND]


def heading(yaw_deg: float) -> np.ndarray:
    half = math.radians(yaw_deg) / 2
    return np.array([math.cos(half), 0.0, 0.0, math.sin(half)])


def vehicle(
    now_s: float, pos=(0.0, 0.0, -2.5), vel=(0.0, 0.0, 0.0), yaw_deg: float = 0.0, **changes: Any
) -> VehicleState:
    return VehicleState(now_s, np.array(pos), np.array(vel), heading(yaw_deg), armed=True, **changes)


def pad(now_s: float, pos=(0.0, 0.0, 0.0), vel=(0.0, 0.0, 0.0), yaw_deg: float = 0.0) -> PadTrack:
    yaw_rad = math.radians(yaw_deg)
    return PadTrack(now_s, np.array(pos), np.array(vel), np.eye(6) * 1e-4, yaw_rad, 0.0, now_s, fixes_accepted=99)


def controller(**changes: Any) -> VelocityController:
    return VelocityController(CONFIG.model_copy(update=changes), SAFETY)


def run(
    steering: VelocityController, goal: Goal, track: Any, state: Any, *, seconds: float, from_s: float = 100.0
) -> list[tuple[Setpoint, GuidanceStatus]]:
    """Turns at 50 Hz; `track` and `state` are functions of time, or stand still."""
    turns = []
    for k in range(round(seconds / DT_S)):
        now_s = from_s + k * DT_S
        seen = track(now_s) if callable(track) else track
        setpoint, status = steering.step(goal, seen, state(now_s) if callable(state) else state, now_s)
        assert setpoint is not None
        turns.append((setpoint, status))
    return turns


# ---------------------------------------------------------------------------------------------------------- the basics
def test_goal_none_says_nothing():
    assert controller().step(Goal(), pad(100.0), vehicle(100.0), 100.0)[0] is None


def test_goal_stay_slows_a_moving_vehicle_to_a_stop_at_the_acceleration_limit():
    turns = run(
        controller(), Goal(GoalKind.STAY, number=1), None, lambda t: vehicle(t, vel=(3.0, 0.0, 0.0)), seconds=1.2
    )
    speeds = np.array([setpoint.vel_ned_m_s[0] for setpoint, _ in turns])
    # 30 m/s3 build 3 m/s2 up in five turns, which come to three at 3 m/s2.
    np.testing.assert_allclose(speeds[5:45], 3.0 - 3.0 * DT_S * (np.arange(6, 46) - 2.0), atol=1e-9)
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9)


def test_hover_beside_the_pad_flies_towards_it_and_holds_the_height():
    turns = run(
        controller(),
        Goal(GoalKind.HOVER, 2.5, number=1),
        pad(100.0, (1.0, -1.0, 0.0)),
        lambda t: vehicle(t),
        seconds=0.4,
    )
    velocity = turns[-1][0].vel_ned_m_s
    assert (
        velocity[0] > 0.3 and velocity[1] == pytest.approx(-velocity[0]) and velocity[2] == pytest.approx(0.0, abs=1e-9)
    )


@pytest.mark.parametrize(("down_m", "sign"), [(-1.5, -1.0), (-3.5, 1.0)])
def test_hover_below_its_height_climbs_and_above_it_sinks(down_m, sign):
    goal = Goal(GoalKind.HOVER, 2.5, number=1)
    turns = run(controller(), goal, pad(100.0), lambda t: vehicle(t, (0.0, 0.0, down_m)), seconds=0.4)
    assert sign * turns[-1][0].vel_ned_m_s[2] > 0.2


@pytest.mark.parametrize(("down_m", "climbed"), [(-2.0, False), (-4.0, True)])
def test_climb_rises_over_the_anchor_and_says_when_it_has(down_m, climbed):
    goal = Goal(GoalKind.CLIMB, 4.0, np.zeros(3), number=1)
    setpoint, status = run(controller(), goal, None, lambda t: vehicle(t, (0.0, 0.0, down_m)), seconds=0.6)[-1]
    assert status.climbed is climbed
    assert setpoint.vel_ned_m_s[2] == pytest.approx(0.0 if climbed else -1.0)


def test_status_tells_distance_height_and_relative_speed():
    goal = Goal(GoalKind.TRACK, 2.5, number=4)
    seen = vehicle(100.0, (1.0, 2.0, -3.0), (1.0, 0.0, 0.0))
    _, status = controller().step(goal, pad(100.0, (4.0, 6.0, -1.0), (1.0, 2.0, 0.0)), seen, 100.0)
    assert (status.goal_number, status.horizontal_error_m, status.height_above_pad_m) == (4, 5.0, 2.0)
    assert status.relative_speed_m_s == pytest.approx(2.0)


def test_pad_and_vehicle_are_compared_at_the_same_instant():
    """Track 0.1 s old, vehicle state 0.05 s old, both at 4 m/s: 0.4 m and 0.2 m on."""
    seen = vehicle(99.95, (0.0, 0.0, -3.0), (4.0, 0.0, 0.0))
    _, status = controller().step(
        Goal(GoalKind.TRACK, 3.0, number=1), pad(99.9, (0.0, 0.0, 0.0), (4.0, 0.0, 0.0)), seen, 100.0
    )
    assert status.horizontal_error_m == pytest.approx(0.2)


# --------------------------------------------------------------------------------------------------------- stale track
@pytest.mark.parametrize("kind", FOLLOWING)
def test_track_that_is_stale_yields_no_velocity_towards_the_pad(kind):
    turns = run(controller(), Goal(kind, 2.5, number=1), pad(99.4, (5.0, 5.0, 0.0)), lambda t: vehicle(t), seconds=2.0)
    fastest = max(float(np.linalg.norm(setpoint.vel_ned_m_s)) for setpoint, _ in turns)
    assert fastest == 0.0
    assert turns[0][1].horizontal_error_m is None and turns[0][1].height_above_pad_m is None


@pytest.mark.parametrize("kind", FOLLOWING)
def test_track_that_becomes_stale_brings_the_vehicle_to_a_stop(kind):
    turns = run(controller(), Goal(kind, 2.5, number=1), pad(100.0, (9.0, 0.0, 0.0)), lambda t: vehicle(t), seconds=2.0)
    speed = np.array([setpoint.vel_ned_m_s[0] for setpoint, _ in turns])
    assert speed[24] > 1.0
    lost = round(0.5 / DT_S) + 1
    assert np.all(np.diff(speed[lost:]) <= 1e-9) and speed[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("kind", FOLLOWING)
def test_track_of_a_driving_pad_that_is_lost_is_coasted_with_never_chased(kind):
    """The pad is 3 m off to the side of its way: sideways nothing is flown, lengthways its speed, for 4 s."""
    lost = pad(99.4, (0.0, 3.0, 0.0), (3.0, 0.0, 0.0))
    turns = run(controller(), Goal(kind, 2.5, number=1), lost, lambda t: vehicle(t, vel=(3.0, 0.0, 0.0)), seconds=6.0)
    sideways = [abs(float(setpoint.vel_ned_m_s[1])) for setpoint, _ in turns]
    lengthways = [float(setpoint.vel_ned_m_s[0]) for setpoint, _ in turns]
    assert max(sideways) == 0.0
    assert max(lengthways) == 3.0 and lengthways[round(3.2 / DT_S)] == 3.0 and lengthways[-1] == 0.0


@pytest.mark.parametrize(
    "bad",
    [
        {"pos_ned_m": np.array([np.nan, 0, 0])},
        {"vel_ned_m_s": np.array([0, np.inf, 0])},
        {"yaw_ned_rad": math.nan},
        {"turn_rate_rad_s": math.nan},
        {"t_capture_s": math.nan},
        {"t_last_fix_s": math.nan},
    ],
)
def test_track_that_is_not_finite_is_no_track(bad):
    setpoint, status = controller().step(
        Goal(GoalKind.TRACK, 2.5, number=1), replace(pad(100.0), **bad), vehicle(100.0), 100.0
    )
    assert (
        setpoint is not None
        and np.isfinite([*setpoint.vel_ned_m_s, *setpoint.acc_ned_m_s2, setpoint.yaw_ned_rad]).all()
    )
    assert status.horizontal_error_m is None


@pytest.mark.parametrize(
    "goal",
    [
        Goal(GoalKind.SEARCH, 5.0, np.array([0.0, 0.0, np.nan]), 1),
        Goal(GoalKind.SEARCH, math.nan, np.zeros(3), 1),
        Goal(GoalKind.CLIMB, math.nan, np.zeros(3), 1),
        Goal(GoalKind.CLIMB, 5.0, np.zeros(3), 1, (math.nan, 0.0)),
        Goal(GoalKind.TRACK, math.nan, np.zeros(3), 1),
    ],
    ids=["search over nowhere", "search", "climb", "climb along", "track"],
)
def test_goal_that_is_not_finite_yields_no_setpoint_and_the_next_one_is_flown(goal):
    steering = controller()
    assert steering.step(goal, pad(100.0), vehicle(100.0), 100.0)[0] is None
    setpoint, _ = steering.step(Goal(GoalKind.STAY, number=2), pad(100.02), vehicle(100.02), 100.02)
    assert setpoint is not None and np.isfinite(setpoint.vel_ned_m_s).all()


def test_deck_whose_lean_is_not_a_number_is_not_landed_on():
    level, unknown = pad(100.0), replace(pad(100.0), lean_rate_ne_rad_s=(math.nan, 0.0))
    state, goal = vehicle(100.0, (0.0, 0.0, -0.3)), Goal(GoalKind.LAND, number=1)
    assert controller().step(goal, level, state, 100.0)[1].committed
    assert not controller().step(goal, unknown, state, 100.0)[1].committed


# ------------------------------------------------------------------------------------------------------------- landing
def committed(now_s: float = 100.0) -> tuple[VelocityController, Goal]:
    steering, goal = controller(), Goal(GoalKind.LAND, number=1)
    status = steering.step(goal, pad(now_s), vehicle(now_s, (0.0, 0.0, -0.3)), now_s)[1]
    assert status.committed
    return steering, goal


def test_landing_that_is_committed_sinks_on_without_the_pad():
    steering, goal = committed()
    sinking = run(
        steering, goal, pad(100.0), lambda t: vehicle(t, (0.0, 0.0, -0.2), (0.0, 0.0, 0.6)), seconds=3.0, from_s=100.02
    )
    assert sinking[-1][0].vel_ned_m_s[2] == pytest.approx(0.6)
    assert all(status.committed and not status.contact for _, status in sinking)


@pytest.mark.parametrize(
    ("roll_deg", "seconds", "sink_m_s"),
    [
        pytest.param(0.0, 0.4, 0.6, id="sink has just begun"),
        pytest.param(0.0, 0.8, 1.5, id="at rest and level"),
        pytest.param(25.0, 0.8, 0.6, id="at rest and leaning into the wind of a fast drive"),
        pytest.param(25.0, 1.2, 1.5, id="in contact"),
    ],
)
def test_landing_presses_onto_the_pad_once_it_stands(roll_deg, seconds, sink_m_s):
    """0.5 s for the sink to build up; then 0.1 s at rest, or 0.35 s for a contact."""
    steering, goal = committed()
    half = math.radians(roll_deg) / 2.0
    leaning = np.array([math.cos(half), math.sin(half), 0.0, 0.0])

    def standing(now_s: float) -> VehicleState:
        return replace(vehicle(now_s, (0.0, 0.0, -0.2)), q_ned_from_body_wxyz=leaning)

    turns = run(steering, goal, pad(100.0), standing, seconds=seconds, from_s=100.02)
    assert turns[-1][0].vel_ned_m_s[2] == pytest.approx(sink_m_s)


def test_landing_that_is_committed_goes_on_with_the_last_track_when_the_new_one_is_unusable():
    steering, goal = committed()
    turns = run(steering, goal, None, lambda t: vehicle(t, (0.0, 0.0, -0.2)), seconds=1.0, from_s=100.02)
    assert turns[-1][1].height_above_pad_m == pytest.approx(0.2)


def test_landing_on_something_solid_is_contact_and_follows_no_error_any_more():
    steering, goal = committed()
    beside = lambda t: vehicle(t, (0.3, 0.0, -0.1))  # noqa: E731  # short enough to read where it is used
    turns = run(steering, goal, lambda t: pad(t), beside, seconds=3.0, from_s=100.02)
    setpoint, status = turns[-1]
    assert status.contact and status.contact_held_s > 1.0
    np.testing.assert_allclose(setpoint.vel_ned_m_s[:2], 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("pad_sinks_m_s", "vehicle_sinks_m_s", "contact"), [(0.0, 0.6, False), (0.3, 0.9, False), (0.6, 0.6, True)]
)
def test_landing_that_sinks_towards_the_pad_is_no_contact_and_one_that_sinks_with_it_is(
    pad_sinks_m_s, vehicle_sinks_m_s, contact
):
    steering, goal = committed()
    sinks = lambda t: vehicle(t, (0.0, 0.0, -0.2), (0.0, 0.0, vehicle_sinks_m_s))  # noqa: E731  # short enough to read where it is used
    deck = lambda t: pad(t, vel=(0.0, 0.0, pad_sinks_m_s))  # noqa: E731  # short enough to read where it is used
    assert run(steering, goal, deck, sinks, seconds=2.0, from_s=100.02)[-1][1].contact is contact


@pytest.mark.parametrize(("rest_s", "kept"), [(1.5, True), (0.0, False)])
def test_landing_that_felt_the_pad_is_not_taken_back_by_what_the_touchdown_made_of_px4s_figures(rest_s, kept):
    """A velocity that is 0.45 m/s wrong ends the contact, and the place and the height run off with it."""
    steering, goal = committed()
    rests = lambda t: vehicle(t, (0.0, 0.0, -0.1))  # noqa: E731  # short enough to read where it is used
    run(steering, goal, lambda t: pad(t), rests, seconds=rest_s, from_s=100.02)
    wrong = lambda t: vehicle(t, (0.5, 0.0, -0.6), (0.0, 0.0, 0.45))  # noqa: E731  # short enough to read where it is used
    _, status = run(steering, goal, lambda t: pad(t), wrong, seconds=0.4, from_s=100.02 + rest_s)[-1]
    assert (status.committed, status.contact) == (kept, False)


def test_landing_on_ground_while_the_pad_drives_on_ends_in_contact_and_not_in_a_go_round():
    """What PX4's simulation of a moving pad does at touchdown (recorded): its ground stands, the pad drives out of
    sight, and its vertical velocity is 0.4 m/s wrong, so that the pad seems to sink away.
    """
    steering, goal = committed()
    last = pad(100.02, (0.0, 0.0, 0.0), (3.5, 0.0, 0.43))
    stands = lambda t: vehicle(t, (0.0, 0.0, -0.15), (0.0, 0.0, 0.36))  # noqa: E731  # short enough to read where it is used
    turns = run(steering, goal, last, stands, seconds=1.5, from_s=100.04)
    assert max(status.height_above_pad_m for _, status in turns) > 0.6  # well above where a commit is taken back
    assert all(status.committed for _, status in turns)
    assert turns[-1][1].contact


def test_landing_begun_anew_is_not_committed():
    steering, goal = committed()
    high = vehicle(100.02, (0.0, 0.0, -2.0))
    assert not steering.step(replace(goal, number=2), pad(100.02), high, 100.02)[1].committed


# ------------------------------------------------------------------------------------------------ memory and its end
def test_next_flight_starts_from_what_the_vehicle_does_then():
    steering = controller()
    run(
        steering,
        Goal(GoalKind.TRACK, 2.5, number=1),
        lambda t: pad(t, (9.0, 0.0, 0.0)),
        lambda t: vehicle(t),
        seconds=2.0,
    )
    steering.forget()
    setpoint, _ = steering.step(Goal(GoalKind.STAY, number=2), None, vehicle(102.02, yaw_deg=90.0), 102.02)
    np.testing.assert_array_equal(setpoint.vel_ned_m_s, 0.0)
    assert setpoint.yaw_ned_rad == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(("silence_s", "expected_m_s"), [(0.1, 1.38 + 0.3), (1.0, 0.012)])
def test_silence_that_outlasts_px4s_patience_starts_from_the_vehicle(silence_s, expected_m_s):
    """3 m/s2 give 1.5 m/s after half a second, less 0.12 while 30 m/s3 build them up. A silence of 0.1 s adds 0.3 m/s;
    one of a second begins from rest.
    """
    steering, goal = controller(), Goal(GoalKind.TRACK, 2.5, number=1)
    far = lambda t: pad(t, (30.0, 0.0, 0.0))  # noqa: E731  # short enough to read where it is used
    before = run(steering, goal, far, lambda t: vehicle(t), seconds=0.5)[-1][0].vel_ned_m_s[0]
    assert before == pytest.approx(1.38)
    now_s = 100.48 + silence_s
    after = steering.step(goal, far(now_s), vehicle(now_s), now_s)[0].vel_ned_m_s[0]
    assert after == pytest.approx(expected_m_s)


def test_silence_on_the_pad_is_not_counted_as_standing_on_it():
    steering, goal = committed()
    rests = lambda t: vehicle(t, (0.0, 0.0, -0.1))  # noqa: E731  # short enough to read where it is used
    assert run(steering, goal, lambda t: pad(t), rests, seconds=1.5, from_s=100.02)[-1][1].contact
    assert not steering.step(goal, pad(109.0), rests(109.0), 109.0)[1].contact


@pytest.mark.parametrize("number", [1, 2])
def test_setpoint_is_continuous_over_a_change_of_goal(number):
    steering = controller()
    before = run(
        steering,
        Goal(GoalKind.TRACK, 2.5, number=1),
        lambda t: pad(t, (9.0, 0.0, 0.0)),
        lambda t: vehicle(t),
        seconds=1.0,
    )
    after, _ = steering.step(Goal(GoalKind.STAY, number=number), None, vehicle(101.0), 101.0)
    step = np.linalg.norm(after.vel_ned_m_s - before[-1][0].vel_ned_m_s)
    assert step <= 3.0 * DT_S * math.sqrt(2.0) + 1e-9


# ------------------------------------------------------------------------------------------ jumps of PX4's local frame
def test_jump_of_the_frame_moves_the_pad_of_a_committed_landing_along():
    """PX4 finds itself 2 m north and 1 m down of where it thought: the pad is where it was, under the vehicle."""
    steering, goal = committed()
    steering.step(goal, pad(100.02), vehicle(100.02, (0.0, 0.0, -0.3)), 100.02)
    jumped = vehicle(100.04, (2.0, 0.0, 0.7), frame_resets=1)
    setpoint, status = steering.step(goal, pad(100.02), jumped, 100.04)
    assert (status.horizontal_error_m, status.height_above_pad_m) == (pytest.approx(0.0), pytest.approx(0.3))
    np.testing.assert_allclose(setpoint.vel_ned_m_s[:2], 0.0, atol=1e-9)


def test_jump_of_the_frame_moves_the_last_track_of_a_committed_landing_when_no_newer_one_comes():
    steering, goal = committed()
    steering.step(goal, pad(100.02), vehicle(100.02, (0.0, 0.0, -0.3)), 100.02)
    _, status = steering.step(goal, None, vehicle(100.04, (2.0, 0.0, 0.7), frame_resets=1), 100.04)
    assert (status.horizontal_error_m, status.height_above_pad_m) == (pytest.approx(0.0), pytest.approx(0.3))


def test_two_jumps_of_the_frame_move_the_pad_of_a_committed_landing_along():
    """The position's and, two turns later, the height's; the newest track is from before both."""
    steering, goal = committed()
    steering.step(goal, pad(100.02), vehicle(100.02, (0.0, 0.0, -0.3)), 100.02)
    steering.step(goal, pad(100.02), vehicle(100.04, (2.0, 0.0, -0.3), frame_resets=1), 100.04)
    _, status = steering.step(goal, pad(100.02), vehicle(100.08, (2.0, 0.0, 0.2), frame_resets=2), 100.08)
    assert (status.horizontal_error_m, status.height_above_pad_m) == (pytest.approx(0.0), pytest.approx(0.3))


def test_goal_from_before_a_jump_that_the_controller_has_seen_already_is_carried_over_it():
    """The mission made it of a vehicle state that is a turn older."""
    steering = controller()
    steering.step(Goal(GoalKind.STAY, number=1), None, vehicle(100.0, (0.0, 0.0, -4.0)), 100.0)
    steering.step(Goal(GoalKind.STAY, number=1), None, vehicle(100.02, (5.0, 0.0, -9.0), frame_resets=1), 100.02)
    goal = Goal(GoalKind.SEARCH, 4.0, np.zeros(3), number=2, frame_s=100.0)
    _, status = steering.step(goal, None, vehicle(100.04, (5.0, 0.0, -9.0), frame_resets=1), 100.04)
    np.testing.assert_allclose(status.anchor_ned_m, [5.0, 0.0, -5.0])
    assert status.frame_s == 100.04


def test_climb_never_sinks():
    """Whatever the height over the anchor is believed to be: it was begun because nothing is known of the pad."""
    goal = Goal(GoalKind.CLIMB, 4.0, np.zeros(3), number=1)
    turns = run(controller(), goal, None, lambda t: vehicle(t, (0.0, 0.0, -9.0)), seconds=2.0)
    assert max(float(setpoint.vel_ned_m_s[2]) for setpoint, _ in turns) <= 0.0
    assert turns[-1][1].climbed


def test_jump_of_the_frame_does_not_move_a_track_from_after_it():
    steering, goal = controller(), Goal(GoalKind.HOVER, 2.5, number=1)
    steering.step(goal, pad(100.0), vehicle(100.0), 100.0)
    steering.step(goal, pad(100.0), vehicle(100.02, (2.0, 0.0, -2.5), frame_resets=1), 100.02)
    later = vehicle(100.06, (2.0, 0.0, -2.5), frame_resets=1)
    _, status = steering.step(goal, pad(100.04, (2.5, 0.0, 0.0)), later, 100.06)
    assert status.horizontal_error_m == pytest.approx(0.5)


def test_jump_of_the_frame_moves_the_height_of_the_search_along():
    steering, goal = controller(), Goal(GoalKind.SEARCH, 4.0, np.zeros(3), number=1)
    run(steering, goal, None, lambda t: vehicle(t, (0.0, 0.0, -4.0)), seconds=0.2)
    jumped = lambda t: vehicle(t, (0.0, 0.0, -9.0), frame_resets=1)  # noqa: E731  # short enough to read where it is used
    turns = run(steering, goal, None, jumped, seconds=1.0, from_s=100.2)
    assert max(abs(float(setpoint.vel_ned_m_s[2])) for setpoint, _ in turns) < 1e-9


# --------------------------------------------------------------------------------------- a pad that drives, far or fast
def test_search_for_a_pad_that_drives_flies_its_pattern_about_a_centre_that_drives():
    """A perfect vehicle passes every corner of the square as the pad, 4 m/s to the north, sees it."""
    drift, speed = np.array([4.0, 0.0]), 2.0
    steering = controller(search_spacing_m=3.0, search_radius_m=6.0, search_speed_m_s=speed)
    goal = Goal(GoalKind.SEARCH, 4.0, np.array([0.0, 0.0, 0.0]), 1, (4.0, 0.0))
    corners = np.array([(0, 0), (3, 0), (3, 3), (-3, 3), (-3, -3), (6, -3)])
    pos, nearest, now_s = np.array([0.0, 0.0, -4.0]), np.full(len(corners), np.inf), 100.0
    for _ in range(round(40.0 / DT_S)):
        setpoint, status = steering.step(goal, None, vehicle(now_s, tuple(pos), (4.0, 0.0, 0.0)), now_s)
        assert setpoint is not None
        now_s += DT_S
        pos = pos + DT_S * setpoint.vel_ned_m_s
        nearest = np.minimum(nearest, np.linalg.norm(drift * (now_s - 100.0) + corners - pos[:2], axis=1))
        if status.search_finished:
            break
    assert status.search_finished
    assert nearest.max() <= 0.6


def test_climb_over_a_pad_that_drives_goes_along_with_it():
    goal = Goal(GoalKind.CLIMB, 4.0, np.zeros(3), 1, (3.0, -1.0))
    turns = run(controller(), goal, None, lambda t: vehicle(t, vel=(3.0, -1.0, 0.0)), seconds=1.0)
    np.testing.assert_allclose(turns[-1][0].vel_ned_m_s[:2], [3.0, -1.0], atol=1e-9)


@pytest.mark.parametrize(
    ("speed_m_s", "told"),
    [(7.5, None), (9.0, 9.0)],  # the vehicle may fly at 8 m/s, and wants 0.3 to make up for what is missing
)
@pytest.mark.parametrize("kind", FOLLOWING)
def test_pad_that_drives_away_too_fast_is_told_after_a_second(kind, speed_m_s, told):
    goal = Goal(kind, 2.5, number=1)
    turns = run(controller(), goal, lambda t: pad(t, vel=(0.0, speed_m_s, 0.0)), vehicle, seconds=1.5)
    said = [status.pad_too_fast_m_s for _, status in turns]
    assert said[:50] == [None] * 50
    assert said[-1] == (None if told is None else pytest.approx(told))


def test_speed_that_is_not_known_well_is_not_too_fast():
    unsure = lambda t: replace(pad(t, vel=(9.0, 0.0, 0.0)), covariance=np.eye(6) * 0.5)  # noqa: E731  # short enough to read where it is used
    turns = run(controller(), Goal(GoalKind.TRACK, 2.5, number=1), unsure, vehicle, seconds=1.5)
    assert turns[-1][1].pad_too_fast_m_s is None


# ----------------------------------------------------------------------------------------------------------------- yaw
@pytest.mark.parametrize(
    ("vehicle_deg", "pad_deg", "after_1_s_deg"),
    [(0.0, 90.0, 45.0), (0.0, -90.0, -45.0), (170.0, -170.0, -172.0), (-170.0, 170.0, 172.0), (10.0, 11.0, 10.0)],
)
def test_yaw_turns_the_short_way_at_its_rate_and_stops_within_two_degrees(vehicle_deg, pad_deg, after_1_s_deg):
    goal = Goal(GoalKind.HOVER, 2.5, number=1)
    turns = run(
        controller(), goal, lambda t: pad(t, yaw_deg=pad_deg), lambda t: vehicle(t, yaw_deg=vehicle_deg), seconds=1.0
    )
    off = math.remainder(turns[-1][0].yaw_ned_rad - math.radians(after_1_s_deg), math.tau)
    assert abs(off) <= math.radians(1.0)
    assert all(-math.pi <= setpoint.yaw_ned_rad <= math.pi for setpoint, _ in turns)


def test_yaw_that_is_not_to_be_aligned_stays():
    goal = Goal(GoalKind.HOVER, 2.5, number=1)
    turns = run(
        controller(align_yaw=False),
        goal,
        lambda t: pad(t, yaw_deg=90.0),
        lambda t: vehicle(t, yaw_deg=30.0),
        seconds=1.0,
    )
    assert turns[-1][0].yaw_ned_rad == pytest.approx(math.radians(30.0))


# -------------------------------------------------------------------------------------------------------------- limits
REACH = st.floats(-60.0, 60.0)
SPEED = st.floats(-12.0, 12.0)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    script=st.lists(
        st.tuples(
            st.sampled_from(list(GoalKind)[1:]),
            st.tuples(REACH, REACH, REACH),
            st.tuples(SPEED, SPEED, st.floats(-3.0, 3.0)),
            st.floats(-180.0, 180.0),
            st.sampled_from([0.0, 0.3, 5.0]),
            st.sampled_from([0.0, 0.005, 0.02, 0.02, 0.1, 0.4]),
        ),
        min_size=2,
        max_size=25,
    )
)
def test_setpoints_keep_their_limits_whatever_the_track_and_the_clock_do(script):
    steering, now_s, previous = controller(), 100.0, None
    for number, (kind, place, velocity, yaw_deg, age_s, dt_s) in enumerate(script):
        now_s += dt_s
        goal = Goal(kind, 2.5, np.zeros(3), number // 3)
        track = pad(now_s - age_s, place, velocity, yaw_deg)
        setpoint, _ = steering.step(goal, track, vehicle(now_s), now_s)
        assert setpoint is not None
        values = [*setpoint.vel_ned_m_s, *setpoint.acc_ned_m_s2, setpoint.yaw_ned_rad]
        assert np.isfinite(values).all()
        assert np.linalg.norm(setpoint.vel_ned_m_s[:2]) <= 8.0 + 1e-9
        assert np.linalg.norm(setpoint.acc_ned_m_s2) <= 3.0 + 1e-9
        if previous is not None:
            slew_s = max(dt_s, 1e-3)
            change = setpoint.vel_ned_m_s - previous.vel_ned_m_s
            assert np.linalg.norm(change[:2]) <= 3.0 * slew_s + 1e-9
            assert abs(change[2]) <= 3.0 * slew_s + 1e-9
            turn = math.remainder(setpoint.yaw_ned_rad - previous.yaw_ned_rad, math.tau)
            assert abs(turn) <= math.radians(45.0) * slew_s + 1e-9
        previous = setpoint


def test_search_that_is_scaled_flies_its_pattern_at_that_size_lower_from_its_anchor_on():
    """Half of a square of 3 m spacing out to 6 m; a perfect vehicle that comes from beside it, and higher."""
    steering = controller(search_spacing_m=3.0, search_radius_m=6.0)
    goal = Goal(GoalKind.SEARCH, 2.5, np.array([10.0, 0.0, 0.0]), 1, pattern_scale=0.5)
    corners = np.array([(10, 0), (11.5, 0), (11.5, 1.5), (8.5, 1.5), (8.5, -1.5), (13, -1.5)])
    pos, nearest, now_s, lowest = np.array([10.0, 6.0, -5.0]), np.full(len(corners), np.inf), 100.0, -5.0
    order = []
    for _ in range(round(60.0 / DT_S)):
        setpoint, status = steering.step(goal, None, vehicle(now_s, tuple(pos)), now_s)
        assert setpoint is not None
        now_s += DT_S
        pos = pos + DT_S * setpoint.vel_ned_m_s
        away = np.linalg.norm(corners - pos[:2], axis=1)
        nearest, lowest = np.minimum(nearest, away), max(lowest, float(pos[2]))
        order += [k for k in np.flatnonzero(away <= 0.6) if k not in order]
        if status.search_finished:
            break
    assert status.search_finished
    assert nearest.max() <= 0.6
    assert order == [0, 1, 2, 3, 4, 5]
    assert -2.6 <= pos[2] <= lowest <= -2.49


def test_search_tells_where_its_anchor_has_drifted_to():
    goal = Goal(GoalKind.SEARCH, 4.0, np.zeros(3), 1, (3.0, 0.0))
    _, status = run(controller(), goal, None, lambda t: vehicle(t, (0.0, 0.0, -4.0)), seconds=2.0)[-1]
    assert status.anchor_ned_m is not None
    np.testing.assert_allclose(status.anchor_ned_m, [6.0, 0.0, 0.0], atol=0.1)


# ---------------------------------------------------------------------------------------------------------------- jerk
@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(FOLLOWING),
    places=st.lists(st.tuples(REACH, REACH, st.floats(0.0, 2.0)), min_size=2, max_size=40),
    velocity=st.tuples(SPEED, SPEED, st.just(0.0)),
)
def test_command_that_follows_a_pad_keeps_the_jerk_limit_however_that_jumps(kind, places, velocity):
    """30 m/s3: its second difference is 0.012 m/s at 50 Hz, on the horizontal and on the vertical."""
    steering, goal, commands = controller(jerk_max_m_s3=30.0), Goal(kind, 2.5, number=1), []
    for k in range(4 * len(places)):
        now_s = 100.0 + k * DT_S
        setpoint, _ = steering.step(goal, pad(now_s, places[k // 4], velocity), vehicle(now_s), now_s)
        assert setpoint is not None
        commands.append(setpoint.vel_ned_m_s)
    second = np.diff(commands, n=2, axis=0)
    assert np.linalg.norm(second[:, :2], axis=1).max() <= 0.012 + 1e-9
    assert np.abs(second[:, 2]).max() <= 0.012 + 1e-9


# --------------------------------------------------------------------------------------------------------------- gusts
def blown(now_s: float) -> VehicleState:
    """Level over the pad, pushed to the north at 1 m/s2 from 100 s on."""
    return vehicle(now_s, vel=(now_s - 100.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [({"gust_share": 0.8}, -0.8), ({"gust_share": 0.0}, 0.0), ({"gust_share": 0.8, "gust_max_m_s2": 0.3}, -0.3)],
)
def test_gust_is_held_against_by_its_share_within_its_limit(changes, expected):
    """STAY asks for zero: it brakes at no rate of its own once it has. The gust is known to 95% after 0.6 s."""
    steering, goal = controller(**changes), Goal(GoalKind.STAY, number=1)
    still = run(steering, goal, None, vehicle, seconds=1.0, from_s=99.0)
    assert still[-1][0].acc_ned_m_s2[0] == pytest.approx(0.0, abs=1e-9)
    setpoint, _ = run(steering, goal, None, blown, seconds=0.6)[-1]
    assert setpoint.acc_ned_m_s2[0] == pytest.approx(expected, abs=0.12)
    np.testing.assert_array_equal(setpoint.acc_ned_m_s2[1:], 0.0)


def test_gust_of_the_last_flight_is_forgotten():
    steering, goal = controller(), Goal(GoalKind.STAY, number=1)
    run(steering, goal, None, vehicle, seconds=1.0, from_s=99.0)
    run(steering, goal, None, blown, seconds=0.6)
    steering.step(Goal(), None, blown(100.6), 100.6)
    setpoint, _ = steering.step(goal, None, blown(100.62), 100.62)
    np.testing.assert_array_equal(setpoint.acc_ned_m_s2[1:], 0.0)
    assert setpoint.acc_ned_m_s2[0] > -0.4  # of the braking itself: a tenth of 3 m/s2
