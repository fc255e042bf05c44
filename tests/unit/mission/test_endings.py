"""What comes after a mission or in place of it: motors off, interruptions, watched holds, the application's end."""

from __future__ import annotations

import math
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
    Hazard,
    LandedState,
    OperatorAction,
    Phase,
    Verdict,
)
from app.mission.endings import is_wound_down
from app.mission.machine import step
from app.mission.states import MissionState, Reason, Transition

A, C, Op, P, M = AutopilotAction, CommandResult, OperatorAction, Phase, FlightMode
STEERING = (P.SEARCH, P.HOVER, P.TRACK, P.LAND)
LOW = np.array([0.0, 0.0, -1.5])
HIGH = np.array([0.0, 0.0, -3.2])


def answers(result: Transition) -> list[tuple[int, CommandResult]]:
    return [(answer.number, answer.result) for answer in result.answers]


def arming(make: Any, **changes: Any) -> MissionState:
    """In TAKEOFF with the one ARM of this order under way since 99.9 s."""
    values = {
        "takeoff_accepted": False,
        "takeoff_seen": False,
        "armed_seen": False,
        "arm_asked": True,
        "pending": A.ARM,
        "asked": A.ARM,
        "asked_s": 99.9,
        "entry_mode": M.HOLD,
        **changes,
    }
    return make.state(P.TAKEOFF, **values)


# --------------------------------------------------------------------------------------------- one arming for an order
@pytest.mark.parametrize("action", [Op.ABORT, Op.HOLD])
def test_abort_while_an_arm_may_be_on_its_way_disarms_until_it_shows(make: Any, action):
    state = arming(make)
    ended = step(state, make.inputs(state, vehicle=make.on_ground(), command=make.command(action)), 100.0, make.config)
    assert (ended.state.phase, ended.cancels, ended.action) == (P.DISARM, True, None)
    first = step(ended.state, make.inputs(ended.state, vehicle=make.on_ground()), 100.05, make.config)
    assert first.action is A.DISARM
    accepted = (ActionResult(A.DISARM, True),)
    off = make.inputs(state, vehicle=make.on_ground(), results=accepted)
    taken = step(first.state, off, 100.1, make.config)
    assert (taken.state.phase, taken.action) == (P.DISARM, None)
    late = step(taken.state, make.inputs(state, vehicle=make.on_ground(armed=True)), 100.6, make.config)
    assert late.action is A.DISARM  # the lost ARM did start the motors
    off_again = step(late.state, off, 100.7, make.config)
    over = step(off_again.state, make.inputs(state, vehicle=make.on_ground()), 101.7, make.config)
    assert over.state.phase is P.IDLE


@pytest.mark.parametrize("refused", [True, False], ids=["refused", "no answer"])
def test_arming_that_fails_is_not_tried_again_and_ends_disarmed(make: Any, refused):
    state = arming(make)
    results = (ActionResult(A.ARM, False, "PX4 refused to arm: no GNSS"),) if refused else ()
    seen = make.inputs(state, vehicle=make.on_ground(), results=results)
    result = step(state, seen, 100.0 if refused else 141.0, make.config)
    assert (result.state.phase, answers(result)) == (P.DISARM, [(1, C.FAILED)])


def test_refusal_to_arm_is_told_in_px4s_words(make: Any):
    state = arming(make)
    results = (ActionResult(A.ARM, False, "PX4 refused to arm: no GNSS"),)
    result = step(state, make.inputs(state, vehicle=make.on_ground(), results=results), 100.0, make.config)
    assert result.texts[0].text == "disarm: PX4 refused to arm: no GNSS"


def test_pilot_who_disarms_before_the_takeoff_is_not_armed_against(make: Any):
    """PX4 arms, the take-off is unanswered, the pilot disarms: no second ARM in 30 s of steps."""
    state = arming(make)
    armed = make.inputs(state, vehicle=make.on_ground(armed=True), results=(ActionResult(A.ARM, True),))
    state = step(state, armed, 100.0, make.config).state
    actions = []
    for k in range(600):
        result = step(state, make.inputs(state, vehicle=make.on_ground()), 100.1 + 0.05 * k, make.config)
        state = result.state
        actions += [result.action] if result.action is not None else []
    assert (state.phase, actions) == (P.IDLE, [])


def test_disarm_that_px4_never_obeys_is_told_loudly(make: Any):
    state = make.state(P.DISARM, since_s=79.9)
    result = step(state, make.inputs(state), 100.0, make.config)
    assert (result.state.phase, result.texts[0].severity.name) == (P.IDLE, "CRITICAL")


def test_disarm_of_a_vehicle_that_is_in_the_air_already_becomes_a_hold(make: Any):
    state = make.state(P.DISARM)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=M.TAKEOFF)), 100.0, make.config)
    assert (result.state.phase, result.action) == (P.HOLD, None)


@pytest.mark.parametrize("phase", [P.FALLBACK_LAND, P.RETURN, P.HOLD, P.TAKEOFF])
@pytest.mark.parametrize("action", [Op.ABORT, Op.HOLD])
def test_abort_of_an_armed_vehicle_on_the_ground_never_takes_off(make: Any, phase, action):
    mode = {P.FALLBACK_LAND: M.LAND, P.RETURN: M.RETURN, P.HOLD: M.HOLD, P.TAKEOFF: M.TAKEOFF}[phase]
    state = make.state(phase)
    seen = make.inputs(state, vehicle=make.on_ground(armed=True, mode=mode), command=make.command(action))
    assert step(state, seen, 100.0, make.config).state.phase is P.DISARM


# ------------------------------------------------------------------------------------------------- pilot and take-off
@pytest.mark.parametrize(
    ("pos", "seen", "after"),
    [(LOW, True, P.IDLE), (LOW, False, P.IDLE), (HIGH, True, P.TAKEOFF), (HIGH, False, P.TAKEOFF)],
)
def test_hold_well_below_the_takeoff_height_is_the_pilots(make: Any, pos, seen, after):
    """PX4 ends its take-off within 0.8 m of the 4 m that were asked for: a hold at 1.5 m is a pause by somebody."""
    state = make.state(P.TAKEOFF, takeoff_seen=seen, takeoff_accepted_s=95.0, entry_mode=M.HOLD)
    vehicle = make.vehicle(mode=M.HOLD, pos_ned_m=pos)
    assert step(state, make.inputs(state, vehicle=vehicle), 100.0, make.config).state.phase is after


def test_takeoff_that_px4_accepts_and_does_not_fly_is_disarmed(make: Any):
    state = make.state(P.TAKEOFF, takeoff_seen=False, takeoff_accepted_s=95.0, entry_mode=M.HOLD)
    result = step(state, make.inputs(state, vehicle=make.on_ground(armed=True)), 100.0, make.config)
    assert (result.state.phase, result.reason) == (P.DISARM, Reason.REFUSED_BY_AUTOPILOT)


# ----------------------------------------------------------------------------------------------- what no order takes
def begin(make: Any, vehicle: Any, phase: Phase = P.IDLE, now_s: float = 100.0, **order: Any) -> Transition:
    state = make.state(phase)
    command = replace(make.command(Op.TRACK), **order)
    return step(state, make.inputs(state, vehicle=vehicle, command=command), now_s, make.config)


@pytest.mark.parametrize("mode", [M.LAND, M.RETURN, M.PRECLAND, M.HOLD, M.OFFBOARD])
@pytest.mark.parametrize("takes_over", [False, True])
def test_order_during_a_failsafe_of_px4_is_refused(make: Any, mode, takes_over):
    result = begin(make, make.vehicle(mode=mode, failsafe=True), takes_over=takes_over)
    assert (result.state.phase, answers(result)) == (P.IDLE, [(2, C.TEMPORARILY_REJECTED)])


@pytest.mark.parametrize("mode", [M.LAND, M.RETURN])
@pytest.mark.parametrize("takes_over", [False, True])
def test_order_during_a_landing_or_return_that_is_not_ours_is_refused(make: Any, mode, takes_over):
    result = begin(make, make.vehicle(mode=mode), takes_over=takes_over)
    assert (result.state.phase, answers(result)) == (P.IDLE, [(2, C.TEMPORARILY_REJECTED)])


@pytest.mark.parametrize("mode", [M.MANUAL, M.ALTITUDE, M.POSITION, M.MISSION, M.OTHER, M.OFFBOARD, M.TAKEOFF])
@pytest.mark.parametrize(("takes_over", "after"), [(False, P.IDLE), (True, P.SEARCH)])
def test_order_in_the_pilots_mode_needs_to_say_that_it_takes_over(make: Any, mode, takes_over, after):
    assert begin(make, make.vehicle(mode=mode), takes_over=takes_over).state.phase is after


def test_order_in_hold_begins_in_the_air(make: Any):
    assert begin(make, make.vehicle(mode=M.HOLD)).state.phase is P.SEARCH


def test_order_on_the_ground_while_the_vehicle_shows_armed_is_refused(make: Any):
    """Right after PX4's own disarm `armed` is a second old: a take-off without arming would follow."""
    result = begin(make, make.on_ground(armed=True))
    assert (result.state.phase, answers(result)) == (P.IDLE, [(2, C.TEMPORARILY_REJECTED)])


@pytest.mark.parametrize("phase", [P.IDLE, P.LANDED, P.HOLD, P.HOVER, P.TRACK])
def test_repeated_order_whose_first_copy_was_not_heard_begins_and_changes_nothing(make: Any, phase):
    state = make.state(phase)
    order = replace(make.command(Op.LAND), repeated=True)
    result = step(state, make.inputs(state, command=order), 100.0, make.config)
    assert (result.state, answers(result)) == (state, [(2, C.TEMPORARILY_REJECTED)])


@pytest.mark.parametrize("action", [Op.HOLD, Op.ABORT])
def test_repeated_hold_and_abort_are_obeyed(make: Any, action):
    state = make.state(P.TRACK)
    order = replace(make.command(action), repeated=True)
    assert step(state, make.inputs(state, command=order), 100.0, make.config).state.phase in (P.HOLD, P.RETURN)


def test_order_that_starts_motors_over_an_open_link_asks_to_be_sent_again(make: Any):
    result = begin(make, make.on_ground(), trusted=False)
    assert result.state.phase is P.IDLE
    assert [(a.result, a.asks_confirmation) for a in result.answers] == [(C.TEMPORARILY_REJECTED, True)]
    assert result.texts[0].text == "track: motors will start, send it again"


def test_order_over_an_open_link_in_the_air_needs_no_second_one(make: Any):
    assert begin(make, make.vehicle(mode=M.HOLD), trusted=False).state.phase is P.SEARCH


@pytest.mark.parametrize(
    ("action", "after_s", "takes_over", "after"),
    [
        (Op.LAND, 29.0, False, P.LANDED),
        (Op.LAND, 31.0, False, P.TAKEOFF),
        (Op.LAND, 1.0, True, P.TAKEOFF),
        (Op.TRACK, 1.0, False, P.TAKEOFF),
    ],
)
def test_same_order_right_after_the_landing_starts_no_motors(make: Any, action, after_s, takes_over, after):
    state = make.state(P.LANDED, last_order=make.command(Op.LAND, number=1))
    order = replace(make.command(action), takes_over=takes_over)
    result = step(state, make.inputs(state, command=order), state.since_s + after_s, make.config)
    assert result.state.phase is after


# --------------------------------------------------------------------------------------------------- what is told
@pytest.mark.parametrize(
    ("word", "landed", "rested", "after"),
    [
        ({"contact": True, "height_above_pad_m": 0.1}, LandedState.IN_AIR, None, P.LANDED),
        ({"height_above_pad_m": 0.1}, LandedState.ON_GROUND, None, P.LANDED),
        ({"height_above_pad_m": 0.1}, LandedState.IN_AIR, 99.0, P.LANDED),
        ({"height_above_pad_m": 0.4}, LandedState.IN_AIR, None, P.IDLE),
    ],
)
def test_motors_that_stop_are_a_landing_only_on_something(make: Any, word, landed, rested, after):
    state = make.state(P.LAND, contact_s=rested)
    seen = make.inputs(
        state, vehicle=make.vehicle(armed=False, landed=landed), guidance=make.settled(state, committed=True, **word)
    )
    assert step(state, seen, 100.0, make.config).state.phase is after


def test_motors_that_stop_over_the_pad_are_told_loudly(make: Any):
    state = make.state(P.LAND)
    word = make.settled(state, committed=True, height_above_pad_m=0.4)
    result = step(state, make.inputs(state, vehicle=make.vehicle(armed=False), guidance=word), 100.0, make.config)
    assert result.texts[0].text == "idle: motors stopped 0.4 m over the pad"
    assert (result.texts[0].severity.name, answers(result)) == ("CRITICAL", [(1, C.FAILED)])


@pytest.mark.parametrize("mode", [M.HOLD, M.POSITION, M.MANUAL])
def test_fallback_landing_ends_as_disarmed_though_px4_changes_its_mode_first(make: Any, mode):
    state = make.state(P.FALLBACK_LAND)
    down = make.inputs(state, vehicle=make.on_ground(armed=True, mode=mode))
    waiting = step(state, down, 100.0, make.config)
    assert (waiting.state.phase, waiting.action) == (P.FALLBACK_LAND, None)
    over = step(waiting.state, make.inputs(state, vehicle=make.on_ground(mode=mode)), 101.0, make.config)
    assert (over.state.phase, over.reason) == (P.IDLE, Reason.DISARMED)


# ------------------------------------------------------------------------------------------------------ interruptions
LOST = Verdict(Hazard.VEHICLE_STATE_STALE, "attitude 0.6 s old")


def interrupted(make: Any, phase: Phase) -> MissionState:
    state = make.state(phase)
    return step(state, make.inputs(state, verdict=LOST), 100.0, make.config).state


@pytest.mark.parametrize("phase", [*STEERING, P.PRECLAND])
def test_stall_within_its_limit_goes_on_with_the_same_phase(make: Any, phase):
    state = interrupted(make, phase)
    assert (state.phase, state.goal.kind) == (P.SUSPENDED, GoalKind.NONE)
    still = step(state, make.inputs(state, vehicle=make.vehicle(), verdict=LOST), 100.5, make.config).state
    mode = M.PRECLAND if phase is P.PRECLAND else M.OFFBOARD
    result = step(still, make.inputs(still, vehicle=make.vehicle(mode=mode)), 100.8, make.config)
    assert (result.state.phase, result.reason, answers(result)[0][1]) == (phase, Reason.RESUMED, C.IN_PROGRESS)
    assert result.state.goal.kind is make.state(phase).goal.kind
    assert result.state.goal.number > make.state(phase).goal.number


@pytest.mark.parametrize(
    ("changes", "now_s"),
    [
        ({"mode": M.HOLD}, 100.8),
        ({"mode": M.OFFBOARD}, 102.5),
        ({"mode": M.OFFBOARD, "frame_resets": 1}, 100.8),
        ({"mode": M.OFFBOARD, "local_position_ok": False}, 100.8),
    ],
)
def test_stall_after_which_anything_differs_ends_in_a_watched_hold(make: Any, changes, now_s):
    state = interrupted(make, P.TRACK)
    result = step(state, make.inputs(state, vehicle=make.vehicle(**changes)), now_s, make.config)
    assert (result.state.phase, answers(result)) == (P.HOLD, [(1, C.FAILED)])
    assert result.state.hold_until_s == pytest.approx(now_s + make.config.hold_max_s)
    assert result.texts[0].text == "hold: link was lost: give a new order"


@pytest.mark.parametrize("mode", [M.POSITION, M.MANUAL, M.ALTITUDE, M.LAND, M.RETURN, M.MISSION])
def test_stall_after_which_somebody_else_flies_is_hands_off(make: Any, mode):
    state = interrupted(make, P.TRACK)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=mode)), 100.8, make.config)
    assert (result.state.phase, result.action, answers(result)) == (P.IDLE, None, [(1, C.FAILED)])


def test_link_that_is_lost_while_arming_ends_disarmed(make: Any):
    state = arming(make)
    seen = make.inputs(state, vehicle=make.on_ground(), verdict=Verdict(Hazard.LINK_LOST, "no heartbeat"))
    assert step(state, seen, 100.0, make.config).state.phase is P.DISARM


# ----------------------------------------------------------------------------------------------------- watched holds
@pytest.mark.parametrize(("ends_in", "after"), [("return", P.RETURN), ("land", P.FALLBACK_LAND)])
def test_hold_that_nobody_asked_for_ends_after_its_time(make: Any, ends_in, after):
    config = make.config.model_copy(update={"hold_end_action": ends_in})
    state = make.state(P.HOLD, hold_until_s=200.0)
    assert step(state, make.inputs(state), 199.9, config).state.phase is P.HOLD
    assert step(state, make.inputs(state), 200.0, config).state.phase is after


def test_hold_that_the_operator_asked_for_lasts(make: Any):
    state = make.state(P.TRACK)
    held = step(state, make.inputs(state, command=make.command(Op.HOLD)), 100.0, make.config).state
    assert held.hold_until_s is None


def test_failed_mission_holds_with_a_limit(make: Any):
    state = make.state(P.HOVER)
    seen = make.inputs(state, verdict=Verdict(Hazard.FRAMES_STALE, "no camera frames"))
    held = step(state, seen, 100.0, make.config).state
    assert held.hold_until_s == pytest.approx(100.0 + make.config.hold_max_s)


def test_hold_that_the_pilot_ended_is_watched_no_more(make: Any):
    state = make.state(P.HOLD, hold_until_s=99.0)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=M.POSITION)), 100.0, make.config)
    assert (result.state.phase, result.action) == (P.IDLE, None)


# ------------------------------------------------------------------------------------------------ the application ends
@pytest.mark.parametrize(
    ("phase", "vehicle", "word", "after"),
    [
        (P.TAKEOFF, {"mode": M.TAKEOFF}, {}, P.HOLD),
        (P.SEARCH, {}, {}, P.HOLD),
        (P.HOVER, {}, {}, P.HOLD),
        (P.TRACK, {}, {}, P.HOLD),
        (P.LAND, {}, {}, P.HOLD),
        (P.LAND, {}, {"committed": True, "height_above_pad_m": 0.3}, P.LAND),
        (P.LAND, {}, {"committed": True, "contact": True, "height_above_pad_m": 0.1}, P.LAND),
        (P.PRECLAND, {"mode": M.PRECLAND}, {"committed": True, "height_above_pad_m": 0.3}, P.PRECLAND),
        (P.SUSPENDED, {}, {}, P.HOLD),
    ],
)
def test_application_that_stops_finishes_on_the_pad_and_holds_elsewhere(make: Any, phase, vehicle, word, after):
    state = make.state(phase)
    seen = make.inputs(state, vehicle=make.vehicle(**vehicle), guidance=make.settled(state, **word), stopping=True)
    assert step(state, seen, 100.0, make.config).state.phase is after


@pytest.mark.parametrize(("contact", "after"), [(True, P.FALLBACK_LAND), (False, P.HOLD)])
def test_application_that_stops_gives_a_landing_eight_seconds(make: Any, contact, after):
    state = make.state(P.LAND, committed_since_s=99.0, stopping_since_s=92.0)
    word = make.settled(state, committed=True, contact=contact, height_above_pad_m=0.1)
    assert step(state, make.inputs(state, guidance=word, stopping=True), 99.9, make.config).state.phase is P.LAND
    assert step(state, make.inputs(state, guidance=word, stopping=True), 100.1, make.config).state.phase is after


def test_application_that_stops_while_arming_switches_the_motors_off(make: Any):
    state = arming(make)
    seen = make.inputs(state, vehicle=make.on_ground(), stopping=True)
    result = step(state, seen, 100.0, make.config)
    assert (result.state.phase, is_wound_down(result.state)) == (P.DISARM, False)


@pytest.mark.parametrize("action", [Op.LAND, Op.TRACK, Op.SEARCH])
def test_application_that_stops_takes_no_order(make: Any, action):
    state = make.state(P.IDLE)
    seen = make.inputs(state, command=make.command(action), stopping=True)
    result = step(state, seen, 100.0, make.config)
    assert (result.state.phase, answers(result)) == (P.IDLE, [(2, C.TEMPORARILY_REJECTED)])


@pytest.mark.parametrize(
    ("phase", "handed_over", "expected"),
    [
        (P.IDLE, False, True),
        (P.LANDED, False, True),
        (P.HOLD, False, False),
        (P.HOLD, True, True),
        (P.LAND, False, False),
    ],
)
def test_application_waits_until_px4_has_the_vehicle(make: Any, phase, handed_over, expected):
    assert is_wound_down(make.state(phase, handed_over=handed_over)) is expected


# ------------------------------------------------------------------------------------------------------- cancellation
@pytest.mark.parametrize(
    ("command", "vehicle"),
    [(Op.HOLD, {"mode": M.HOLD}), (None, {"mode": M.POSITION})],
    ids=["held by the operator", "taken by the pilot"],
)
def test_request_that_is_pending_is_cancelled_when_the_phase_ends(make: Any, command, vehicle):
    state = make.state(P.SEARCH, offboard_seen=False, pending=A.OFFBOARD, asked=A.OFFBOARD, entry_mode=M.HOLD)
    order = None if command is None else make.command(command)
    result = step(state, make.inputs(state, vehicle=make.vehicle(**vehicle), command=order), 100.0, make.config)
    assert result.cancels and result.action is None


def test_request_that_was_answered_is_not_cancelled(make: Any):
    state = make.state(P.HOLD, handed_over=False, pending=A.HOLD, asked=A.HOLD, asked_s=99.9)
    seen = make.inputs(state, results=(ActionResult(A.HOLD, True),))
    assert not step(state, seen, 100.0, make.config).cancels


def test_velocity_that_is_not_a_number_is_no_standing_on_the_ground(make: Any):
    state = make.state(P.FALLBACK_LAND)
    vehicle = make.on_ground(armed=True, mode=M.LAND, vel_ned_m_s=np.full(3, math.nan))
    seen = make.inputs(state, vehicle=vehicle, command=make.command(Op.ABORT))
    assert step(state, seen, 100.0, make.config).state.phase is P.RETURN
