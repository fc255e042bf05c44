"""Jumps of PX4's local frame: what the mission remembers of places goes along."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from app.messages import Goal, GoalKind, LandedState, Phase
from app.mission.machine import step
from app.mission.states import MissionState

P = Phase
JUMP = np.array([0.0, 6.0, -3.0])


def at(make: Any, t_s: float, pos: tuple[float, float, float], resets: int = 0, **changes: Any) -> Any:
    return make.vehicle(t_capture_s=t_s, pos_ned_m=np.array(pos), frame_resets=resets, **changes)


def climbing(make: Any) -> MissionState:
    """Over (1, 2), the ground at 0; the vehicle is 2 m up and seen once."""
    goal = Goal(GoalKind.CLIMB, 4.0, np.array([1.0, 2.0, 0.0]), 7)
    state = make.state(P.SEARCH, goal=goal)
    seen = make.inputs(state, vehicle=at(make, 100.0, (1.0, 2.0, -2.0)), guidance=make.settled(state, 100.0))
    return step(state, seen, 100.0, make.config).state


def test_climb_over_a_jump_ends_in_a_search_over_the_same_place(make: Any):
    state = climbing(make)
    after = at(make, 100.05, (1.0, 8.0, -5.0), resets=1)
    state = step(state, make.inputs(state, vehicle=after, guidance=None), 100.05, make.config).state
    # The controller has followed the jump too, and says so by the time of the state that it went by.
    word = make.settled(state, 102.0, climbed=True, anchor_ned_m=np.array([1.0, 8.0, -3.0]), frame_s=102.0)
    high = at(make, 102.0, (1.0, 8.0, -7.0), resets=1)
    goal = step(state, make.inputs(state, vehicle=high, guidance=word), 102.0, make.config).state.goal
    assert (goal.kind, goal.height_m, goal.frame_s) == (GoalKind.SEARCH, 4.0, 102.0)
    np.testing.assert_allclose(goal.anchor_ned_m, [1.0, 8.0, -3.0])


def test_word_of_the_controller_from_before_the_jump_is_carried_over_it(make: Any):
    state = climbing(make)
    word = make.settled(state, 100.04, climbed=True, anchor_ned_m=np.array([1.5, 2.0, 0.0]), frame_s=100.0)
    after = at(make, 100.05, (1.0, 8.0, -5.0), resets=1)
    goal = step(state, make.inputs(state, vehicle=after, guidance=word), 100.05, make.config).state.goal
    assert goal.kind is GoalKind.SEARCH
    np.testing.assert_allclose(goal.anchor_ned_m, [1.5, 8.0, -3.0])


def test_motion_between_two_states_is_no_jump(make: Any):
    state = climbing(make)
    first = at(make, 100.0, (1.0, 2.0, -2.0), vel_ned_m_s=np.array([0.0, 0.0, -1.0]))
    state = step(state, make.inputs(state, vehicle=first, guidance=None), 100.0, make.config).state
    after = at(make, 100.5, (1.0, 8.0, -5.5), resets=1)
    state = step(state, make.inputs(state, vehicle=after, guidance=None), 100.5, make.config).state
    np.testing.assert_allclose(state.goal.anchor_ned_m, [1.0, 8.0, -3.0])


def test_take_off_over_a_jump_ends_at_its_true_height(make: Any):
    """3 m higher by PX4's word, and no higher over the ground."""
    state = make.state(P.TAKEOFF, home_ned_m=np.zeros(3))
    flies = {"mode": make.inputs(state).vehicle.mode, "landed": LandedState.IN_AIR}
    for t_s, down_m, resets, phase in (
        (100.0, -2.0, 0, P.TAKEOFF),
        (100.05, -5.0, 1, P.TAKEOFF),
        (101.0, -6.5, 1, P.TAKEOFF),
        (102.0, -6.7, 1, P.SEARCH),  # 3.7 of 4 m
    ):
        seen = make.inputs(state, vehicle=at(make, t_s, (0.0, 0.0, down_m), resets, **flies), guidance=None)
        state = step(state, seen, t_s, make.config).state
        assert state.phase is phase, t_s
    assert state.home_ned_m is not None
    np.testing.assert_allclose(state.home_ned_m, [0.0, 0.0, -3.0])


def test_pad_that_was_last_seen_before_the_jump_is_searched_for_where_it_is_after_it(make: Any):
    state = make.state(P.HOVER)
    before = make.inputs(state, vehicle=at(make, 100.0, (1.0, 2.0, -2.5)), track=make.track(t_last_fix_s=99.0))
    state = step(state, before, 100.0, make.config).state
    after = replace(before, vehicle=at(make, 100.5, (1.0, 8.0, -5.5), resets=1))
    state = step(state, after, 100.5, make.config).state
    lost = step(state, replace(after, vehicle=at(make, 101.1, (1.0, 8.0, -5.5), resets=1)), 101.1, make.config).state
    assert (lost.phase, lost.goal.kind, lost.goal.height_m) == (P.SEARCH, GoalKind.CLIMB, 4.0)
    np.testing.assert_allclose(lost.goal.anchor_ned_m, np.array([1.0, 2.0, 0.0]) + JUMP)
