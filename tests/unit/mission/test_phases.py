"""What each phase waits for: entering, settling, landing, losing the pad, time limits, tries."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.messages import (
    ActionResult,
    AutopilotAction,
    CommandResult,
    FlightMode,
    GoalKind,
    LandedState,
    OperatorAction,
    Phase,
)
from app.mission.machine import step
from app.mission.states import MissionState, Reason, Transition

A, C, Op, P = AutopilotAction, CommandResult, OperatorAction, Phase


def answers(result: Transition) -> list[tuple[int, CommandResult]]:
    return [(answer.number, answer.result) for answer in result.answers]


# ----------------------------------------------------------------------------------------------------------- take-off
def test_takeoff_arms_then_takes_off_to_the_search_height(make: Any):
    state = step(
        make.state(P.IDLE), make.inputs(make.state(P.IDLE), command=make.command(Op.LAND)), 100.0, make.config
    ).state
    arming = step(state, make.inputs(state, vehicle=make.on_ground()), 100.05, make.config)
    assert arming.action is A.ARM
    armed = make.on_ground(armed=True)
    climbing = step(
        arming.state, make.inputs(state, vehicle=armed, results=(ActionResult(A.ARM, True),)), 100.1, make.config
    )
    assert (climbing.action, climbing.action_height_m) == (A.TAKEOFF, make.config.search_height_m)


@pytest.mark.parametrize("mode", [FlightMode.OFFBOARD, FlightMode.LAND, FlightMode.RETURN])
def test_takeoff_from_the_mode_that_the_last_flight_ended_in_takes_hold_first(make: Any, mode):
    """PX4 denies arming in offboard without setpoints, and says that it is not armable there."""
    landed = make.state(P.LANDED)
    rests = make.on_ground(mode=mode, armable=False)
    begun = step(landed, make.inputs(landed, vehicle=rests, command=make.command(Op.LAND)), 100.0, make.config).state
    assert begun.phase is P.TAKEOFF
    first = step(begun, make.inputs(begun, vehicle=rests), 100.05, make.config)
    assert first.action is A.HOLD
    told = make.inputs(begun, vehicle=rests, results=(ActionResult(A.HOLD, True),))
    lagging = step(first.state, told, 100.1, make.config)
    assert lagging.action is None
    second = step(lagging.state, make.inputs(begun, vehicle=make.on_ground()), 100.3, make.config)
    assert second.action is A.ARM


@pytest.mark.parametrize(
    ("height_m", "landed", "after"),
    [
        (3.5, LandedState.IN_AIR, P.TAKEOFF),  # 90% of 4 m are 3.6 m
        (3.7, LandedState.TAKING_OFF, P.TAKEOFF),
        (3.7, LandedState.IN_AIR, P.SEARCH),
    ],
)
def test_takeoff_ends_in_the_air_near_the_search_height_over_home(make: Any, height_m, landed, after):
    state = make.state(P.TAKEOFF, home_ned_m=np.array([0.0, 0.0, -1.0]))
    vehicle = make.vehicle(pos_ned_m=np.array([0.0, 0.0, -1.0 - height_m]), landed=landed, mode=FlightMode.TAKEOFF)
    assert step(state, make.inputs(state, vehicle=vehicle), 100.0, make.config).state.phase is after


@pytest.mark.parametrize(
    ("vehicle", "arm_asked", "after"),
    [
        ({"armed": False}, False, P.IDLE),
        ({"armed": False}, True, P.DISARM),
        ({"armed": True}, True, P.DISARM),
        ({"armed": True, "landed": LandedState.IN_AIR}, True, P.FALLBACK_LAND),
    ],
)
def test_takeoff_refused_three_times_gives_up_where_it_is_safe(make: Any, vehicle, arm_asked, after):
    state = make.state(
        P.TAKEOFF,
        takeoff_accepted=False,
        takeoff_seen=False,
        refusals=3,
        arm_asked=arm_asked,
        entry_mode=FlightMode.HOLD,
    )
    result = step(state, make.inputs(state, vehicle=make.on_ground(**vehicle)), 100.0, make.config)
    assert (result.state.phase, result.reason) == (after, Reason.REFUSED_BY_AUTOPILOT)
    assert answers(result) == [(1, C.FAILED)]


def test_takeoff_that_does_not_climb_in_time_is_landed(make: Any):
    state = make.state(P.TAKEOFF)
    vehicle = make.vehicle(pos_ned_m=np.array([0.0, 0.0, -1.0]), mode=FlightMode.TAKEOFF)
    late_s = state.since_s + make.config.takeoff_timeout_s + 0.1
    result = step(state, make.inputs(state, vehicle=vehicle), late_s, make.config)
    assert (result.state.phase, result.reason) == (P.FALLBACK_LAND, Reason.TIMED_OUT)


def test_takeoff_that_px4_disarms_again_is_over(make: Any):
    state = make.state(P.TAKEOFF)
    result = step(state, make.inputs(state, vehicle=make.on_ground()), 100.0, make.config)
    assert (result.state.phase, answers(result)) == (P.IDLE, [(1, C.FAILED)])


# ----------------------------------------------------------------------------------------- asking again, in good time
def test_action_that_was_refused_is_asked_again_after_a_second(make: Any):
    state = make.state(P.HOLD, handed_over=False, pending=A.HOLD, asked=A.HOLD, asked_s=100.0)
    seen = make.inputs(state, vehicle=make.vehicle())
    refused = step(state, replace(seen, results=(ActionResult(A.HOLD, False),)), 100.2, make.config).state
    assert step(refused, seen, 100.9, make.config).action is None
    assert step(refused, seen, 101.0, make.config).action is A.HOLD


def test_action_that_was_accepted_is_not_asked_again_while_telemetry_lags(make: Any):
    state = make.state(P.HOLD, handed_over=False, pending=A.HOLD, asked=A.HOLD, asked_s=100.0)
    seen = make.inputs(state, vehicle=make.vehicle())
    accepted = step(state, replace(seen, results=(ActionResult(A.HOLD, True),)), 100.05, make.config)
    assert accepted.action is None
    assert step(accepted.state, seen, 102.4, make.config).action is None
    again = step(accepted.state, seen, 102.5, make.config)
    assert (again.action, again.state.refusals) == (A.HOLD, 1)


def test_action_whose_answer_never_comes_is_given_up(make: Any):
    state = make.state(P.HOLD, handed_over=False, pending=A.HOLD, asked=A.HOLD, asked_s=100.0)
    seen = make.inputs(state, vehicle=make.vehicle())
    assert step(state, seen, 139.0, make.config).state.pending is A.HOLD
    assert step(state, seen, 140.1, make.config).action is A.HOLD


# -------------------------------------------------------------------------------------------------- entering offboard
def entering(make: Any, **changes: Any) -> MissionState:
    state = make.state(P.SEARCH, since_s=100.0, offboard_seen=False, entry_mode=FlightMode.HOLD)
    return replace(state, goal=replace(state.goal, kind=GoalKind.STAY), **changes)


def test_offboard_is_asked_for_after_half_a_second_of_setpoints(make: Any):
    state = entering(make)
    seen = make.inputs(state, vehicle=make.vehicle(mode=FlightMode.HOLD))
    assert step(state, seen, 100.45, make.config).action is None
    assert step(state, seen, 100.5, make.config).action is A.OFFBOARD


def test_offboard_that_shows_before_it_was_accepted_is_a_late_reading(make: Any):
    asked = entering(make, pending=A.OFFBOARD, asked=A.OFFBOARD, asked_s=100.5)
    seen = make.inputs(asked, vehicle=make.vehicle(mode=FlightMode.OFFBOARD))
    assert not step(asked, seen, 100.55, make.config).state.offboard_seen
    told = replace(seen, results=(ActionResult(A.OFFBOARD, True),))
    assert step(asked, told, 100.6, make.config).state.offboard_seen


def test_offboard_accepted_but_never_shown_is_the_pilot_and_is_not_asked_again(make: Any):
    accepted = entering(make, asked=A.OFFBOARD, asked_s=100.5, accepted=A.OFFBOARD)
    seen = make.inputs(accepted, vehicle=make.vehicle(mode=FlightMode.HOLD))
    assert step(accepted, seen, 102.9, make.config).state.phase is P.SEARCH
    result = step(accepted, seen, 103.0, make.config)
    assert (result.state.phase, result.action, answers(result)) == (P.IDLE, None, [(1, C.CANCELLED)])


def test_offboard_refused_three_times_fails_the_mission(make: Any):
    state = entering(make, asked=A.OFFBOARD, asked_s=100.5, refusals=3)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=FlightMode.HOLD)), 103.0, make.config)
    assert (result.state.phase, result.reason) == (P.HOLD, Reason.REFUSED_BY_AUTOPILOT)
    assert answers(result) == [(1, C.FAILED)]


def test_pilot_who_takes_over_while_offboard_is_entered_from_hold_has_it(make: Any):
    state = entering(make, asked=A.OFFBOARD, asked_s=100.5, accepted=A.OFFBOARD)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=FlightMode.POSITION)), 100.6, make.config)
    assert (result.state.phase, result.action) == (P.IDLE, None)


def test_mode_on_the_ground_is_the_pilots_once_px4_has_taken_off(make: Any):
    state = make.state(P.TAKEOFF, entry_mode=FlightMode.POSITION, takeoff_seen=False, takeoff_accepted_s=99.5)
    low = np.array([0.0, 0.0, -1.0])
    lagging = make.vehicle(mode=FlightMode.POSITION, pos_ned_m=low)
    assert step(state, make.inputs(state, vehicle=lagging), 100.0, make.config).state.phase is P.TAKEOFF
    climbing = make.vehicle(mode=FlightMode.TAKEOFF, pos_ned_m=low)
    seen = step(state, make.inputs(state, vehicle=climbing), 100.1, make.config).state
    result = step(seen, make.inputs(seen, vehicle=lagging), 100.2, make.config)
    assert (result.state.phase, result.reason) == (P.IDLE, Reason.PILOT_TOOK_OVER)


# -------------------------------------------------------------------------------------------------------- handing over
OWN = [
    (P.HOLD, A.HOLD, FlightMode.HOLD),
    (P.RETURN, A.RETURN, FlightMode.RETURN),
    (P.FALLBACK_LAND, A.LAND, FlightMode.LAND),
]


@pytest.mark.parametrize(("phase", "action", "mode"), OWN)
def test_handing_over_asks_once_and_ends_when_the_mode_shows(make: Any, phase, action, mode):
    state = make.state(phase, handed_over=False, entry_mode=FlightMode.OFFBOARD)
    lagging = make.inputs(state, vehicle=make.vehicle(mode=FlightMode.OFFBOARD))
    first = step(state, lagging, 100.0, make.config)
    assert first.action is action
    second = step(first.state, replace(lagging, results=(ActionResult(action, True),)), 100.05, make.config)
    assert (second.action, second.state.handed_over) == (None, False)
    third = step(second.state, make.inputs(state, vehicle=make.vehicle(mode=mode)), 100.6, make.config)
    assert (third.action, third.state.handed_over) == (None, True)


@pytest.mark.parametrize(("phase", "action", "mode"), OWN)
def test_handing_over_asks_even_if_the_mode_shows_already(make: Any, phase, action, mode):
    state = make.state(phase, handed_over=False)
    assert step(state, make.inputs(state, vehicle=make.vehicle(mode=mode)), 100.0, make.config).action is action


@pytest.mark.parametrize(("phase", "action", "mode"), OWN)
def test_handing_over_to_a_pilot_who_was_quicker_is_not_insisted_on(make: Any, phase, action, mode):
    state = make.state(phase, handed_over=False, entry_mode=FlightMode.OFFBOARD, asked=action, accepted=action)
    late = replace(state, asked_s=100.0)
    result = step(late, make.inputs(state, vehicle=make.vehicle(mode=FlightMode.POSITION)), 100.3, make.config)
    assert (result.state.phase, result.action) == (P.IDLE, None)


@pytest.mark.parametrize(("phase", "action", "mode"), OWN)
def test_handing_over_that_px4_refuses_three_times_is_told_loudly(make: Any, phase, action, mode):
    state = make.state(phase, handed_over=False, asked=action, asked_s=99.0, refusals=3)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=FlightMode.OFFBOARD)), 100.0, make.config)
    assert (result.state.phase, result.texts[0].severity.name) == (P.IDLE, "CRITICAL")


@pytest.mark.parametrize("action", [Op.LAND, Op.TRACK, Op.SEARCH])
def test_command_while_a_hand_over_is_on_its_way_waits(make: Any, action):
    state = make.state(P.HOLD, handed_over=False, pending=A.HOLD, asked=A.HOLD, asked_s=99.95)
    seen = make.inputs(state, vehicle=make.vehicle(mode=FlightMode.OFFBOARD), command=make.command(action))
    result = step(state, seen, 100.0, make.config)
    assert (result.state, answers(result)) == (state, [(2, C.TEMPORARILY_REJECTED)])


# -------------------------------------------------------------------------------------------------- search and hover
def test_search_begins_over_the_place_of_entry_at_the_search_height_over_home(make: Any):
    state = entering(make, offboard_seen=True, home_ned_m=np.array([9.0, 9.0, -0.5]))
    result = step(state, make.inputs(state), 101.0, make.config)
    assert (result.state.goal.kind, result.state.goal.height_m) == (GoalKind.SEARCH, 4.0)
    np.testing.assert_allclose(result.state.goal.anchor_ned_m, [1.0, 2.0, -0.5])


def test_search_with_a_usable_track_hovers_over_it(make: Any):
    state = make.state(P.SEARCH)
    result = step(state, make.inputs(state, track=make.track(), track_usable=True), 100.0, make.config)
    assert (result.state.phase, result.state.goal.kind, result.state.goal.height_m) == (P.HOVER, GoalKind.HOVER, 2.5)


@pytest.mark.parametrize("changes", [{"search_finished": True}, {}])
def test_last_search_that_is_flown_out_or_takes_too_long_fails(make: Any, changes):
    state = make.state(P.SEARCH, ground_known=True, search_passes=make.config.search_passes - 1)
    late_s = state.since_s + (make.config.search_timeout_s + 0.1 if not changes else 5.0)
    seen = make.inputs(state, guidance=make.settled(state, late_s, **changes))
    result = step(state, seen, late_s, make.config)
    assert (result.state.phase, result.reason, answers(result)) == (P.HOLD, Reason.PAD_NOT_FOUND, [(1, C.FAILED)])


def run_for(make: Any, state: MissionState, seconds: float) -> Transition:
    """Steps at 20 Hz with everything in order, until something is decided or the time is over."""
    result = Transition(state)
    for k in range(round(seconds * 20)):
        now_s = 100.0 + 0.05 * k
        seen = make.inputs(
            result.state, track=make.track(t_last_fix_s=now_s), guidance=make.settled(result.state, now_s)
        )
        result = step(result.state, seen, now_s, make.config)
        if result.reason is not None or result.answers:
            break
    return result


def test_hover_settled_for_a_second_goes_on_to_track(make: Any):
    result = run_for(make, make.state(P.HOVER), 2.0)
    assert (result.state.phase, result.state.since_s) == (P.TRACK, pytest.approx(101.0))


def test_hover_that_was_searched_for_is_the_end_of_the_command_and_stays(make: Any):
    result = run_for(make, make.state(P.HOVER, command=make.command(Op.SEARCH, 1)), 2.0)
    assert (result.state.phase, answers(result)) == (P.HOVER, [(1, C.ACCEPTED)])
    assert run_for(make, result.state, 60.0).state.phase is P.HOVER


def test_track_that_was_asked_for_is_the_end_of_the_command_and_stays(make: Any):
    result = run_for(make, make.state(P.TRACK, command=make.command(Op.TRACK, 1)), 2.0)
    assert (result.state.phase, answers(result)) == (P.TRACK, [(1, C.ACCEPTED)])
    assert run_for(make, result.state, 60.0).state.phase is P.TRACK


def test_track_height_of_the_command_is_taken(make: Any):
    state = make.state(P.HOVER, command=make.command(Op.TRACK, 1, height_m=6.0))
    assert run_for(make, state, 2.0).state.goal.height_m == 6.0


def test_track_before_a_landing_lasts_its_time(make: Any):
    result = run_for(make, make.state(P.TRACK, since_s=100.0), 10.0)
    assert (result.state.phase, result.state.since_s) == (P.LAND, pytest.approx(104.0, abs=0.051))


@pytest.mark.parametrize(
    "wrong",
    [
        {"horizontal_error_m": 0.45},
        {"relative_speed_m_s": 0.6},
        {"height_above_pad_m": 3.2},
        {"horizontal_error_m": None},
        {"height_above_pad_m": None},
        {"relative_speed_m_s": None},
    ],
)
@pytest.mark.parametrize("phase", [P.HOVER, P.TRACK])
def test_not_settled_in_time_goes_round(make: Any, phase, wrong):
    state = make.state(phase)
    limit_s = make.config.hover_timeout_s + (make.config.track_time_before_land_s if phase is P.TRACK else 0.0)
    now_s = state.since_s + limit_s + 0.1
    seen = make.inputs(state, track=make.track(t_last_fix_s=now_s), guidance=make.settled(state, now_s, **wrong))
    result = step(state, seen, now_s, make.config)
    assert (result.state.phase, result.reason, result.state.tries) == (P.SEARCH, Reason.TIMED_OUT, 1)


# --------------------------------------------------------------------------------------------- lost, missed, gone round
@pytest.mark.parametrize("phase", [P.HOVER, P.TRACK, P.LAND])
@pytest.mark.parametrize(("age_s", "after"), [(1.9, None), (2.1, P.SEARCH)])
def test_pad_unseen_for_a_second_is_searched_for_anew(make: Any, phase, age_s, after):
    state = make.state(phase)
    seen = make.inputs(state, track=make.track(t_last_fix_s=100.0 - age_s))
    result = step(state, seen, 100.0, make.config)
    assert result.state.phase is (after or phase)
    assert result.state.goal.kind is (GoalKind.CLIMB if after else state.goal.kind)


def test_pad_lost_over_a_moving_pad_climbs_over_where_it_is_expected(make: Any):
    state = make.state(P.TRACK)
    track = make.track(t_capture_s=97.5, t_last_fix_s=97.5, vel_ned_m_s=np.array([2.0, 0.0, 0.0]))
    result = step(state, make.inputs(state, track=track), 100.0, make.config)
    np.testing.assert_allclose(result.state.goal.anchor_ned_m, [1.0 + 2.5 * 2.0, 2.0, 0.0])
    assert (result.state.goal.height_m, result.state.offboard_seen, result.action) == (4.0, True, None)


@pytest.mark.parametrize(("north_m_s", "drift"), [(2.0, (2.0, 0.0)), (0.8, (0.0, 0.0))])
def test_search_for_a_pad_that_drove_when_it_was_lost_goes_along_with_it(make: Any, north_m_s, drift):
    state = make.state(P.TRACK)
    track = make.track(t_capture_s=97.5, t_last_fix_s=97.5, vel_ned_m_s=np.array([north_m_s, 0.0, 0.0]))
    climbing = step(state, make.inputs(state, track=track), 100.0, make.config).state
    assert climbing.goal.drift_ne_m_s == drift
    # The controller has moved the anchor along for the 2 s of the climb.
    moved = climbing.goal.anchor_ned_m + 2.0 * np.array([*drift, 0.0])
    word = make.settled(climbing, 102.0, climbed=True, anchor_ned_m=moved)
    seen = make.inputs(climbing, track=track, track_usable=False, guidance=word)
    searching = step(climbing, seen, 102.0, make.config).state
    assert (searching.goal.kind, searching.goal.drift_ne_m_s) == (GoalKind.SEARCH, drift)
    # 4.5 s after it was seen a pad that drives is so far on; one that was slow is looked for where it was lost.
    assert searching.goal.anchor_ned_m[0] == pytest.approx(1.0 + (4.5 * 2.0 if drift[0] else 2.5 * 0.8))


@pytest.mark.parametrize(("height_m", "wanted_m"), [(1.0, 4.0), (20.0, 20.0)])
def test_vehicle_that_flies_higher_than_the_search_height_searches_from_there(make: Any, height_m, wanted_m):
    """The phone had it track from over trees: nothing is to be searched for among them."""
    state = make.state(P.TRACK)
    vehicle = make.vehicle(pos_ned_m=np.array([1.0, 2.0, -height_m]))
    seen = make.inputs(state, vehicle=vehicle, track=make.track(t_last_fix_s=97.5))
    climbing = step(state, seen, 100.0, make.config).state
    assert (climbing.goal.kind, climbing.goal.height_m) == (GoalKind.CLIMB, wanted_m)
    word = make.settled(climbing, 104.0, climbed=True)
    searching = step(climbing, replace(seen, track_usable=False, guidance=word), 104.0, make.config).state
    assert (searching.goal.kind, searching.goal.height_m) == (GoalKind.SEARCH, wanted_m)


def test_pad_that_the_phone_says_drives_is_searched_for_along_its_way(make: Any):
    state = make.state(P.SEARCH)
    state = replace(state, goal=replace(state.goal, kind=GoalKind.STAY))
    state = replace(state, command=replace(state.command, pad_drives_ne_m_s=(0.0, 3.75)))
    begun = step(state, make.inputs(state), 100.0, make.config).state
    assert (begun.goal.kind, begun.goal.drift_ne_m_s) == (GoalKind.SEARCH, (0.0, 3.75))


@pytest.mark.parametrize("phase", [P.HOVER, P.TRACK, P.LAND])
def test_pad_that_drives_away_too_fast_is_given_up_in_words(make: Any, phase):
    state = make.state(phase)
    word = make.settled(state, pad_too_fast_m_s=9.04)
    result = step(state, make.inputs(state, guidance=word), 100.0, make.config)
    assert (result.state.phase, result.reason) == (P.HOLD, Reason.PAD_TOO_FAST)
    assert [text.text for text in result.texts] == ["hold: the pad drives away too fast: 9.0 m/s"]
    assert [r for _, r in answers(result)] == [C.FAILED]


def test_committed_landing_is_not_given_up_for_the_pads_speed(make: Any):
    state = make.state(P.LAND)
    word = make.settled(state, committed=True, pad_too_fast_m_s=9.0)
    assert step(state, make.inputs(state, guidance=word), 100.0, make.config).state.phase is P.LAND


def test_pad_unseen_for_long_is_not_expected_far_away(make: Any):
    state = make.state(P.LAND, committed_since_s=90.0)
    track = make.track(t_capture_s=90.0, t_last_fix_s=90.0, vel_ned_m_s=np.array([4.0, 0.0, 0.0]))
    word = make.settled(state, committed=True, height_above_pad_m=-0.4)
    result = step(state, make.inputs(state, track=track, guidance=word), 100.0, make.config)
    assert result.state.goal.anchor_ned_m[0] == pytest.approx(1.0 + 4.0 * 4.0)


@pytest.mark.parametrize(("tries", "after"), [(0, P.SEARCH), (1, P.SEARCH), (2, P.HOLD)])
def test_going_round_ends_with_the_tries(make: Any, tries, after):
    state = make.state(P.LAND, tries=tries)
    seen = make.inputs(state, track=make.track(t_last_fix_s=97.0))
    result = step(state, seen, 100.0, make.config)
    assert (result.state.phase, result.state.tries) == (after, tries + (1 if after is P.SEARCH else 0))
    assert [r for _, r in answers(result)] == [C.IN_PROGRESS if after is P.SEARCH else C.FAILED]


def test_climb_that_has_arrived_goes_on_to_the_pattern_over_the_same_place(make: Any):
    state = make.state(P.SEARCH)
    state = replace(state, goal=replace(state.goal, kind=GoalKind.CLIMB, anchor_ned_m=np.array([5.0, 6.0, 0.0])))
    result = step(state, make.inputs(state, guidance=make.settled(state, climbed=True)), 100.0, make.config)
    assert (result.state.goal.kind, result.state.goal.number) == (GoalKind.SEARCH, 8)
    np.testing.assert_allclose(result.state.goal.anchor_ned_m, [5.0, 6.0, 0.0])


# ------------------------------------------------------------------------------------------------------------ landing
def landing(make: Any, **word: Any) -> tuple[MissionState, Any]:
    state = make.state(P.LAND)
    return state, make.settled(state, committed=True, **word)


def test_landing_without_a_commit_in_time_goes_round(make: Any):
    state = make.state(P.LAND)
    now_s = state.since_s + make.config.land_timeout_s + 0.1
    seen = make.inputs(state, track=make.track(t_last_fix_s=now_s), guidance=make.settled(state, now_s))
    assert step(state, seen, now_s, make.config).reason is Reason.TIMED_OUT


def test_landing_of_which_the_controller_says_nothing_still_loses_the_pad(make: Any):
    state = make.state(P.LAND)
    seen = make.inputs(state, guidance=None, track=make.track(t_last_fix_s=97.0))
    assert step(state, seen, 100.0, make.config).reason is Reason.PAD_LOST


def test_landing_committed_goes_on_without_the_pad(make: Any):
    state, word = landing(make, height_above_pad_m=0.2)
    seen = make.inputs(state, guidance=word, track=make.track(t_last_fix_s=97.0))
    result = step(state, seen, 100.0, make.config)
    assert (result.state.phase, result.action) == (P.LAND, None)


def test_landing_sunk_past_the_pad_goes_round(make: Any):
    state, word = landing(make, height_above_pad_m=-0.36)
    assert step(state, make.inputs(state, guidance=word), 100.0, make.config).reason is Reason.PAD_MISSED


def test_landing_that_stands_on_the_pad_is_not_missed_by_a_height_that_drifts(make: Any):
    state, word = landing(make, height_above_pad_m=-0.2, contact=True)
    stands = step(state, make.inputs(state, guidance=word), 100.0, make.config).state
    drifted = replace(word, height_above_pad_m=-0.5)
    stands = step(stands, make.inputs(stands, guidance=drifted), 103.0, make.config).state
    assert stands.phase is P.LAND
    off = replace(drifted, contact=False)
    assert step(stands, make.inputs(stands, guidance=off), 103.9, make.config).state.phase is P.LAND
    assert step(stands, make.inputs(stands, guidance=off), 104.1, make.config).reason is Reason.PAD_MISSED


@pytest.mark.parametrize(("contact", "after"), [(False, P.SEARCH), (True, P.FALLBACK_LAND)])
def test_landing_committed_for_too_long_is_ended(make: Any, contact, after):
    state, word = landing(make, height_above_pad_m=0.2, contact=contact)
    first = step(state, make.inputs(state, guidance=word), 100.0, make.config).state
    late = make.inputs(state, guidance=word, track=make.track(t_last_fix_s=120.0), may_force_disarm=contact)
    assert step(first, late, 119.9, make.config).state.phase is P.LAND
    result = step(first, late, 120.1, make.config)
    assert (result.state.phase, result.reason) == (after, Reason.TIMED_OUT)


@pytest.mark.parametrize(
    ("may_force", "contact", "landed", "action"),
    [
        (True, True, LandedState.IN_AIR, A.FORCE_DISARM),
        (False, True, LandedState.ON_GROUND, A.DISARM),
        (False, True, LandedState.IN_AIR, None),
        (False, False, LandedState.ON_GROUND, None),
    ],
)
def test_landing_committed_disarms_when_it_may(make: Any, may_force, contact, landed, action):
    state, word = landing(make, height_above_pad_m=0.1, contact=contact)
    seen = make.inputs(state, guidance=word, vehicle=make.vehicle(landed=landed), may_force_disarm=may_force)
    assert step(state, seen, 100.0, make.config).action is action


@pytest.mark.parametrize("phase", [p for p in Phase if p is not P.LAND])
def test_forced_disarm_outside_a_landing_is_never_asked_for(make: Any, phase):
    state = make.state(phase)
    assert step(state, make.inputs(state, may_force_disarm=True), 100.0, make.config).action is not A.FORCE_DISARM


def test_forced_disarm_before_the_commit_is_never_asked_for(make: Any):
    state = make.state(P.LAND)
    assert step(state, make.inputs(state, may_force_disarm=True), 100.0, make.config).action is None


# ---------------------------------------------------------------------------------------- from one mission to the next
@pytest.mark.parametrize("phase", [P.TAKEOFF, P.SEARCH, P.HOVER, P.TRACK, P.LAND])
def test_home_is_forgotten_when_the_mission_is_over(make: Any, phase):
    state = make.state(phase)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=FlightMode.POSITION)), 100.0, make.config)
    assert result.state.home_ned_m is None


def test_mission_in_the_air_without_a_home_searches_at_the_height_it_has(make: Any):
    state = make.state(P.IDLE)
    high = make.vehicle(pos_ned_m=np.array([0.0, 0.0, -20.0]), mode=FlightMode.POSITION)
    order = replace(make.command(Op.SEARCH), takes_over=True)
    begun = step(state, make.inputs(state, vehicle=high, command=order), 100.0, make.config).state
    assert (begun.phase, begun.entry_mode) == (P.SEARCH, FlightMode.POSITION)
    assert begun.home_ned_m[2] - make.config.search_height_m == pytest.approx(-20.0)


def test_mission_after_a_hold_keeps_its_home(make: Any):
    state = make.state(P.HOLD, home_ned_m=np.array([0.0, 0.0, 3.0]))
    begun = step(state, make.inputs(state, command=make.command(Op.LAND)), 100.0, make.config).state
    np.testing.assert_allclose(begun.home_ned_m, [0.0, 0.0, 3.0])


def test_mission_begun_anew_starts_with_no_tries_used_and_offboard_to_be_seen(make: Any):
    state = make.state(P.HOLD, tries=2, offboard_seen=True, takeoff_accepted=True)
    begun = step(state, make.inputs(state, command=make.command(Op.LAND)), 100.0, make.config).state
    assert (begun.tries, begun.offboard_seen, begun.takeoff_accepted) == (0, False, False)


def test_command_when_the_land_detector_is_silent_is_refused(make: Any):
    state = make.state(P.IDLE)
    vehicle = make.vehicle(landed=LandedState.UNKNOWN, mode=FlightMode.POSITION)
    result = step(state, make.inputs(state, vehicle=vehicle, command=make.command(Op.LAND)), 100.0, make.config)
    assert (result.state, answers(result)) == (state, [(2, C.TEMPORARILY_REJECTED)])
