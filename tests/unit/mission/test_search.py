"""Searching lower: heights and sizes by hand, where it starts from, and when there is no lower pass."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.config import MissionConfig
from app.messages import FlightMode, Goal, GoalKind, OperatorAction, Phase
from app.mission.machine import step
from app.mission.states import MissionState, Reason, Transition

P = Phase
ANCHOR = np.array([3.0, -2.0, -0.5])


def searching(make: Any, height_m: float = 5.0, **changes: Any) -> MissionState:
    goal = Goal(GoalKind.SEARCH, height_m, ANCHOR, 7)
    return make.state(P.SEARCH, **{"goal": goal, "ground_known": True, **changes})


def flown_out(make: Any, state: MissionState, now_s: float = 200.0, **config: Any) -> Transition:
    word = make.settled(state, now_s, search_finished=True, anchor_ned_m=state.goal.anchor_ned_m)
    return step(state, make.inputs(state, guidance=word), now_s, MissionConfig(**config))


def test_search_that_is_flown_out_begins_again_lower_and_smaller_over_the_same_anchor(make: Any):
    """0.6 of 5 m, and 0.6 of the pattern; a new number starts it at its first corner, the anchor."""
    result = flown_out(make, searching(make))
    goal = result.state.goal
    assert (result.state.phase, result.reason, goal.kind, goal.number) == (
        P.SEARCH,
        Reason.SEARCHES_LOWER,
        GoalKind.SEARCH,
        8,
    )
    assert (goal.height_m, goal.pattern_scale) == (pytest.approx(3.0), pytest.approx(0.6))
    np.testing.assert_array_equal(goal.anchor_ned_m, ANCHOR)
    assert result.texts[0].text == "search: not found, searching lower, at 3.0 m"


def test_passes_go_down_to_the_least_height_and_no_lower_and_then_it_fails(make: Any):
    """10, 5, then 2.5 m would follow: the least height is 4; a pass at 4 m has no lower one after it."""
    passes, state = [(10.0, 1.0)], searching(make, height_m=10.0)
    figures = {"search_height_min_m": 4.0, "search_lower_share": 0.5, "search_passes": 10}
    result = flown_out(make, state, **figures)
    while result.state.phase is P.SEARCH:
        passes.append((result.state.goal.height_m, result.state.goal.pattern_scale))
        result = flown_out(make, result.state, **figures)
    assert passes == [(10.0, 1.0), (pytest.approx(5.0), pytest.approx(0.5)), (pytest.approx(4.0), pytest.approx(0.4))]
    assert (result.state.phase, result.reason) == (P.HOLD, Reason.PAD_NOT_FOUND)


@pytest.mark.parametrize(("passes", "after"), [(1, P.HOLD), (2, P.SEARCH)])
def test_number_of_passes_is_limited(make: Any, passes, after):
    assert flown_out(make, searching(make, height_m=20.0), search_passes=passes).state.phase is after


@pytest.mark.parametrize("height_m", [2.0, 2.7])
def test_search_that_is_hardly_over_the_least_height_or_under_it_is_flown_once(make: Any, height_m):
    """From 2.7 m to 2.5 m is 7% and shows nothing new; from 2 m it would go up."""
    assert flown_out(make, searching(make, height_m)).state.phase is P.HOLD


def test_pass_that_takes_too_long_is_followed_by_the_lower_one_which_has_the_whole_time_again(make: Any):
    state, limit_s = searching(make, since_s=100.0), MissionConfig().search_timeout_s
    late = step(state, make.inputs(state), 100.1 + limit_s, MissionConfig())
    assert (late.reason, late.state.goal.height_m) == (Reason.SEARCHES_LOWER, pytest.approx(3.0))
    still = step(late.state, make.inputs(late.state), 100.0 + 2.0 * limit_s, MissionConfig())
    assert (still.state.phase, still.reason) == (P.SEARCH, None)


def test_lower_search_for_a_pad_that_drives_is_about_where_its_centre_has_got_to(make: Any):
    state = searching(make, goal=Goal(GoalKind.SEARCH, 5.0, ANCHOR, 7, (3.0, 0.0)))
    moved = np.array([303.0, -2.0, -0.5])
    word = make.settled(state, 200.0, search_finished=True, anchor_ned_m=moved)
    goal = step(state, make.inputs(state, guidance=word), 200.0, MissionConfig()).state.goal
    np.testing.assert_array_equal(goal.anchor_ned_m, moved)
    assert goal.drift_ne_m_s == (3.0, 0.0)


def test_ground_that_was_never_seen_is_not_approached(make: Any):
    """A mission that begins in the air takes the ground to be the search height below, which it may not be."""
    idle = make.state(P.IDLE)
    order = make.command(OperatorAction.LAND)
    begun = step(
        idle, make.inputs(idle, vehicle=make.vehicle(mode=FlightMode.HOLD), command=order), 100.0, make.config
    ).state
    assert (begun.phase, begun.ground_known) == (P.SEARCH, False)
    state = replace(begun, goal=Goal(GoalKind.SEARCH, 5.0, ANCHOR, 7), offboard_seen=True)
    assert flown_out(make, state).state.phase is P.HOLD


def test_ground_is_known_by_taking_off_from_it(make: Any):
    idle = make.state(P.IDLE)
    begun = step(idle, make.inputs(idle, command=make.command(OperatorAction.LAND)), 100.0, make.config).state
    assert (begun.phase, begun.ground_known) == (P.TAKEOFF, True)


def test_ground_is_known_by_the_pad_that_was_seen_on_it(make: Any):
    state = make.state(P.TRACK, ground_known=False)
    seen = make.inputs(state, track=make.track(t_last_fix_s=97.0), track_usable=False)
    lost = step(state, seen, 100.0, make.config).state
    assert (lost.phase, lost.ground_known) == (P.SEARCH, True)


def test_search_after_a_loss_begins_at_the_search_height_with_all_its_passes(make: Any):
    state = make.state(P.TRACK, ground_known=True, search_passes=2)
    seen = make.inputs(state, track=make.track(t_last_fix_s=97.0), track_usable=False)
    lost = step(state, seen, 100.0, make.config).state
    assert (lost.goal.height_m, lost.goal.pattern_scale, lost.search_passes) == (make.config.search_height_m, 1.0, 0)


def test_mission_that_is_over_leaves_no_known_ground_behind(make: Any):
    result = flown_out(make, searching(make), search_passes=1, failure_action="hold")
    pilot = step(result.state, make.inputs(result.state, vehicle=make.vehicle(armed=False)), 201.0, make.config)
    assert (pilot.state.phase, pilot.state.ground_known) == (P.IDLE, False)


# ------------------------------------------------------------------------------------ a pad that drove when it was lost
def along(make: Any, seen_s: float = 97.0) -> MissionState:
    """Lost at 100 s while it drove north at 2 m/s; the climb is done, and the search goes along with it."""
    track = make.track(t_capture_s=seen_s, t_last_fix_s=seen_s, vel_ned_m_s=np.array([2.0, 0.0, 0.0]))
    state = make.state(P.LAND, ground_known=True)
    climbing = step(state, make.inputs(state, track=track, track_usable=False), 100.0, make.config).state
    word = make.settled(climbing, 102.0, climbed=True, anchor_ned_m=np.array([11.0, 2.0, 0.0]))
    return step(climbing, make.inputs(climbing, guidance=word), 102.0, make.config).state


def test_search_turns_back_to_where_a_pad_was_last_seen_that_is_not_where_it_would_be_if_it_drove_on(make: Any):
    """97 s + 15 s; the controller's word of the anchor is 5 m further east: PX4's frame has jumped meanwhile."""
    state, config = along(make), MissionConfig(search_along_s=15.0)
    assert (state.goal.kind, state.goal.drift_ne_m_s) == (GoalKind.SEARCH, (2.0, 0.0))
    early = step(state, make.inputs(state, guidance=make.settled(state, 111.9)), 111.9, config)
    assert (early.reason, early.state.goal) == (None, state.goal)
    anchor = np.array([1.0 + 15.0 * 2.0, 7.0, 0.0])
    word = make.settled(state, 112.0, anchor_ned_m=anchor)
    back = step(state, make.inputs(state, guidance=word), 112.0, config)
    assert (back.state.phase, back.reason) == (P.SEARCH, Reason.TURNS_BACK)
    assert [text.text for text in back.texts] == ["search: not found ahead, turning back"]
    goal = back.state.goal
    assert (goal.kind, goal.drift_ne_m_s, goal.pattern_scale) == (GoalKind.SEARCH, (0.0, 0.0), 1.0)
    assert (goal.height_m, goal.number) == (state.goal.height_m, state.goal.number + 1)
    np.testing.assert_allclose(goal.anchor_ned_m, [1.0, 7.0, 0.0])


def test_search_turns_back_once_and_has_its_whole_time_then(make: Any):
    state = along(make)
    word = make.settled(state, 120.0, anchor_ned_m=np.array([47.0, 2.0, 0.0]))
    back = step(state, make.inputs(state, guidance=word), 120.0, make.config).state
    word = make.settled(back, 270.0, anchor_ned_m=back.goal.anchor_ned_m)
    later = step(back, make.inputs(back, guidance=word), 270.0, make.config)
    assert (later.reason, later.state.goal) == (None, back.goal)


@pytest.mark.parametrize("end", [{"search_finished": True}, {}])
def test_search_that_is_over_before_it_would_turn_back_turns_back_then(make: Any, end):
    """A small pattern is flown out, or its time is up, 6 s after the pad was seen; it is not the last pass either."""
    state, config = along(make), MissionConfig(search_timeout_s=300.0 if end else 0.5, search_passes=1)
    word = make.settled(state, 103.0, anchor_ned_m=np.array([13.0, 2.0, 0.0]), **end)
    back = step(state, make.inputs(state, guidance=word), 103.0, config)
    assert (back.state.phase, back.reason, back.state.search_passes) == (P.SEARCH, Reason.TURNS_BACK, 0)
    np.testing.assert_allclose(back.state.goal.anchor_ned_m, [1.0, 2.0, 0.0])


def test_search_along_the_way_that_the_phone_gave_does_not_turn_back(make: Any):
    """Nobody has seen where it began."""
    state = searching(make, goal=Goal(GoalKind.SEARCH, 5.0, ANCHOR, 7, (3.0, 0.0)))
    word = make.settled(state, 200.0, anchor_ned_m=ANCHOR)
    assert step(state, make.inputs(state, guidance=word), 200.0, make.config).reason is None


def test_pad_that_is_found_and_lost_again_is_gone_along_with_from_then_on(make: Any):
    found = step(along(make), make.inputs(along(make), track=make.track(), track_usable=True), 105.0, make.config).state
    assert (found.phase, found.left_behind_s) == (P.HOVER, None)


@pytest.mark.parametrize("kind", [GoalKind.SEARCH, GoalKind.CLIMB])
def test_search_goes_along_as_the_phone_says_from_then_on(make: Any, kind):
    """It was told nothing, or the wrong way; the anchor is where it has got to by now."""
    state = searching(make, goal=Goal(kind, 5.0, ANCHOR, 7, (3.0, 0.0), pattern_scale=0.6), left_behind_s=96.0)
    order = replace(make.command(OperatorAction.LAND), pad_drives_ne_m_s=(0.0, 3.75))
    word = make.settled(state, 98.0, anchor_ned_m=np.array([12.0, -2.0, -0.5]))
    told = step(state, make.inputs(state, guidance=word, command=order), 98.0, make.config)
    goal = told.state.goal
    assert (told.state.phase, goal.kind, goal.drift_ne_m_s) == (P.SEARCH, kind, (0.0, 3.75))
    assert (goal.number, goal.height_m, goal.pattern_scale) == (8, 5.0, 0.6)
    np.testing.assert_allclose(goal.anchor_ned_m, [12.0, -2.0, -0.5])
    assert (told.state.left_behind_s, told.state.since_s) == (None, 98.0)


def test_order_without_a_speed_leaves_the_search_as_it_is(make: Any):
    state = searching(make, goal=Goal(GoalKind.SEARCH, 5.0, ANCHOR, 7, (3.0, 0.0)))
    told = step(state, make.inputs(state, command=make.command(OperatorAction.LAND)), 98.0, make.config)
    assert told.state.goal.number == 7
    assert told.state.goal.drift_ne_m_s == (3.0, 0.0)
