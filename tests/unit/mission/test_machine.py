"""The state machine over all phases and all inputs: what each does, against a table written from the design."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from app.messages import (
    ActionResult,
    AutopilotAction,
    CommandAnswer,
    CommandResult,
    FlightMode,
    GoalKind,
    Hazard,
    OperatorAction,
    Phase,
    Response,
    Verdict,
)
from app.mission.machine import step
from app.mission.states import Reason

C, Op, P = CommandResult, OperatorAction, Phase
BEGIN = (Op.LAND, Op.TRACK, Op.SEARCH)
GROUNDED = (P.IDLE, P.LANDED)
STEERING = (P.SEARCH, P.HOVER, P.TRACK, P.LAND)
ACTIVE = (P.TAKEOFF, *STEERING, P.PRECLAND)
HANDED_OVER = (P.HOLD, P.RETURN, P.FALLBACK_LAND)
NEW, OLD = 2, 1

STARTED = [(NEW, C.IN_PROGRESS)]
CHANGED = [(OLD, C.CANCELLED), (NEW, C.IN_PROGRESS)]
ENDED = [(OLD, C.CANCELLED), (NEW, C.ACCEPTED)]

COMMANDS: list[tuple[Phase, OperatorAction, Phase, list[tuple[int, CommandResult]]]] = [
    *((phase, action, P.TAKEOFF, STARTED) for phase in GROUNDED for action in BEGIN),
    *((phase, action, phase, [(NEW, C.DENIED)]) for phase in GROUNDED for action in (Op.HOLD, Op.ABORT)),
    *((phase, action, phase, CHANGED) for phase in (P.TAKEOFF, P.SEARCH, P.HOVER) for action in BEGIN),
    (P.TRACK, Op.LAND, P.TRACK, CHANGED),
    (P.TRACK, Op.TRACK, P.TRACK, CHANGED),
    (P.TRACK, Op.SEARCH, P.HOVER, CHANGED),
    (P.LAND, Op.LAND, P.LAND, CHANGED),
    (P.LAND, Op.TRACK, P.TRACK, CHANGED),
    (P.LAND, Op.SEARCH, P.HOVER, CHANGED),
    (P.PRECLAND, Op.LAND, P.PRECLAND, CHANGED),
    *((P.PRECLAND, action, P.SEARCH, CHANGED) for action in (Op.TRACK, Op.SEARCH)),
    *((phase, Op.HOLD, P.HOLD, ENDED) for phase in ACTIVE),
    *((phase, Op.ABORT, P.RETURN, ENDED) for phase in ACTIVE),
    *((phase, action, P.SEARCH, STARTED) for phase in HANDED_OVER for action in BEGIN),
    *((phase, Op.HOLD, P.HOLD, [(NEW, C.ACCEPTED)]) for phase in HANDED_OVER),
    *((phase, Op.ABORT, P.RETURN, [(NEW, C.ACCEPTED)]) for phase in HANDED_OVER),
    *((phase, action, phase, [(NEW, C.TEMPORARILY_REJECTED)]) for phase in (P.SUSPENDED, P.DISARM) for action in BEGIN),
    (P.SUSPENDED, Op.HOLD, P.HOLD, [(NEW, C.ACCEPTED)]),
    (P.SUSPENDED, Op.ABORT, P.RETURN, [(NEW, C.ACCEPTED)]),
    *((P.DISARM, action, P.DISARM, [(NEW, C.ACCEPTED)]) for action in (Op.HOLD, Op.ABORT)),
]


def answers(given: tuple[CommandAnswer, ...]) -> list[tuple[int, CommandResult]]:
    return [(answer.number, answer.result) for answer in given]


def test_command_table_covers_every_phase_and_every_command():
    assert {(phase, action) for phase, action, _, _ in COMMANDS} == {(p, o) for p in Phase for o in OperatorAction}
    assert len(COMMANDS) == len(Phase) * len(OperatorAction)


@pytest.mark.parametrize(("phase", "action", "after", "told"), COMMANDS)
def test_command_in_each_phase_leads_where_the_table_says(make: Any, phase, action, after, told):
    state = make.state(phase)
    result = step(state, make.inputs(state, command=make.command(action)), 100.0, make.config)
    assert result.state.phase is after
    assert answers(result.answers) == told


@pytest.mark.parametrize(("abort_action", "after"), [("hold", P.HOLD), ("return", P.RETURN), ("land", P.FALLBACK_LAND)])
def test_abort_in_flight_takes_the_configured_action(make: Any, abort_action, after):
    config = make.config.model_copy(update={"abort_action": abort_action})
    state = make.state(P.TRACK)
    result = step(state, make.inputs(state, command=make.command(Op.ABORT)), 100.0, config)
    assert result.state.phase is after


@pytest.mark.parametrize("action", [Op.HOLD, Op.ABORT])
def test_hold_and_abort_of_a_committed_landing_in_the_air_are_obeyed(make: Any, action):
    state = make.state(P.LAND)
    seen = make.inputs(state, command=make.command(action), guidance=make.settled(state, committed=True))
    assert step(state, seen, 100.0, make.config).state.phase in HANDED_OVER


@pytest.mark.parametrize("action", [Op.HOLD, Op.ABORT])
def test_hold_and_abort_on_the_pad_are_refused_for_now(make: Any, action):
    state = make.state(P.LAND)
    word = make.settled(state, committed=True, contact=True)
    result = step(state, make.inputs(state, command=make.command(action), guidance=word), 100.0, make.config)
    assert (result.state.phase, answers(result.answers)) == (P.LAND, [(NEW, C.TEMPORARILY_REJECTED)])


@pytest.mark.parametrize("action", BEGIN)
def test_change_of_aim_of_a_committed_landing_is_refused_and_the_landing_goes_on(make: Any, action):
    state = make.state(P.LAND)
    seen = make.inputs(state, command=make.command(action), guidance=make.settled(state, committed=True))
    result = step(state, seen, 100.0, make.config)
    assert (result.state, answers(result.answers)) == (state, [(NEW, C.TEMPORARILY_REJECTED)])


@pytest.mark.parametrize("height_m", [0.1, 0.499, 50.1, 5000.0, -2.0, float("nan"), float("inf")])
@pytest.mark.parametrize("phase", [P.IDLE, P.HOVER, P.HOLD])
def test_command_with_a_height_out_of_range_is_denied(make: Any, phase, height_m):
    state = make.state(phase)
    seen = make.inputs(state, command=make.command(Op.TRACK, height_m=height_m))
    result = step(state, seen, 100.0, make.config)
    assert (result.state, answers(result.answers)) == (state, [(NEW, C.DENIED)])


def test_command_without_an_armable_vehicle_is_refused_for_now(make: Any):
    state = make.state(P.IDLE)
    seen = make.inputs(state, vehicle=make.on_ground(armable=False), command=make.command(Op.LAND))
    result = step(state, seen, 100.0, make.config)
    assert (result.state, answers(result.answers)) == (state, [(NEW, C.TEMPORARILY_REJECTED)])


def test_command_without_a_vehicle_is_refused_for_now(make: Any):
    state = make.state(P.IDLE)
    seen = make.inputs(state, vehicle=None, guidance=None, command=make.command(Op.SEARCH))
    assert answers(step(state, seen, 100.0, make.config).answers) == [(NEW, C.TEMPORARILY_REJECTED)]


@pytest.mark.parametrize("hazard", list(Hazard))
def test_command_on_the_ground_with_a_hazard_is_refused_with_its_words(make: Any, hazard):
    state = make.state(P.IDLE)
    seen = make.inputs(state, verdict=Verdict(hazard, "battery 12% under 15%"), command=make.command(Op.LAND))
    result = step(state, seen, 100.0, make.config)
    assert answers(result.answers) == [(NEW, C.TEMPORARILY_REJECTED)]
    assert result.texts[0].text == "land refused: battery 12% under 15%"


# ----------------------------------------------------------------------------------------------------------- hazards
RESPONSE = {
    Hazard.LINK_LOST: P.SUSPENDED,
    Hazard.VEHICLE_STATE_STALE: P.SUSPENDED,
    Hazard.MODE_UNKNOWN: P.SUSPENDED,
    Hazard.POSITION_LOST: P.FALLBACK_LAND,
    Hazard.TILT_EXCESSIVE: P.HOLD,
    Hazard.FRAMES_FROZEN: P.HOLD,
    Hazard.PAD_COPIES_VEHICLE: P.HOLD,
    Hazard.CAMERA_TIME_WRONG: P.HOLD,
    Hazard.TOO_FAST: P.HOLD,
    Hazard.CONTROL_LATE: P.HOLD,
    Hazard.BATTERY_LOW: P.FALLBACK_LAND,
    Hazard.BATTERY_UNKNOWN: P.FALLBACK_LAND,
    Hazard.FENCE_LEFT: P.RETURN,
    Hazard.TOO_FAR: P.RETURN,
    Hazard.TOO_HIGH: P.HOLD,
    Hazard.ESTIMATOR_BAD: P.HOLD,
    Hazard.WIND_EXCESSIVE: P.HOLD,
    Hazard.FRAMES_UNUSABLE: P.HOLD,
    Hazard.FRAMES_STALE: P.HOLD,
}
STOPPING = {Hazard.LINK_LOST, Hazard.VEHICLE_STATE_STALE, Hazard.MODE_UNKNOWN}


@pytest.mark.parametrize("hazard", list(Hazard))
def test_hazard_that_does_not_end_a_mission_is_only_warned_of(hazard):
    assert (hazard in RESPONSE) is (Verdict(hazard, "words").response is not Response.WARN)


@pytest.mark.parametrize("phase", ACTIVE)
@pytest.mark.parametrize("hazard", list(RESPONSE))
def test_hazard_in_an_active_phase_ends_the_mission_as_its_response_says(make: Any, phase, hazard):
    state = make.state(phase)
    result = step(state, make.inputs(state, verdict=Verdict(hazard, "words")), 100.0, make.config)
    assert (result.state.phase, result.reason) == (RESPONSE[hazard], Reason.SAFETY)
    assert answers(result.answers) == ([] if RESPONSE[hazard] is P.SUSPENDED else [(OLD, C.FAILED)])
    assert result.state.goal.kind is GoalKind.NONE


WATCHED = {
    (P.HOLD, Hazard.POSITION_LOST): P.FALLBACK_LAND,
    (P.HOLD, Hazard.BATTERY_LOW): P.FALLBACK_LAND,
    (P.HOLD, Hazard.BATTERY_UNKNOWN): P.FALLBACK_LAND,
    (P.HOLD, Hazard.TOO_FAR): P.RETURN,
    (P.HOLD, Hazard.FENCE_LEFT): P.RETURN,
}
"""What a hazard makes of a mode of PX4's that Alight left the vehicle in; PX4 finishes all the others by itself."""


@pytest.mark.parametrize("phase", [*GROUNDED, *HANDED_OVER])
@pytest.mark.parametrize("hazard", list(RESPONSE))
def test_hazard_after_a_mission_acts_on_a_hold_and_leaves_the_rest_to_px4(make: Any, phase, hazard):
    state = make.state(phase)
    result = step(state, make.inputs(state, verdict=Verdict(hazard, "words")), 100.0, make.config)
    assert result.state.phase is WATCHED.get((phase, hazard), phase)


@pytest.mark.parametrize("phase", HANDED_OVER)
def test_lost_position_ends_a_return_and_a_hold_in_px4s_landing(make: Any, phase):
    state = make.state(phase)
    mode = {P.HOLD: FlightMode.HOLD, P.RETURN: FlightMode.RETURN, P.FALLBACK_LAND: FlightMode.LAND}[phase]
    vehicle = make.vehicle(mode=mode, local_position_ok=False)
    seen = make.inputs(state, vehicle=vehicle, verdict=Verdict(Hazard.POSITION_LOST, "words"))
    assert step(state, seen, 100.0, make.config).state.phase is P.FALLBACK_LAND


@pytest.mark.parametrize("mode", [FlightMode.POSITION, FlightMode.MANUAL, FlightMode.MISSION])
@pytest.mark.parametrize("hazard", list(RESPONSE))
def test_hazard_while_the_pilot_flies_takes_nothing_from_the_pilot(make: Any, mode, hazard):
    state = make.state(P.IDLE)
    seen = make.inputs(state, vehicle=make.vehicle(mode=mode), verdict=Verdict(hazard, "words"))
    result = step(state, seen, 100.0, make.config)
    assert (result.state, result.action) == (state, None)


@pytest.mark.parametrize("hazard", list(Hazard))
def test_hazard_in_a_committed_landing_counts_only_if_it_forbids_commanding(make: Any, hazard):
    state = make.state(P.LAND)
    seen = make.inputs(state, verdict=Verdict(hazard, "words"), guidance=make.settled(state, committed=True))
    assert step(state, seen, 100.0, make.config).state.phase is (P.SUSPENDED if hazard in STOPPING else P.LAND)


@pytest.mark.parametrize(
    ("height_m", "contact", "after"), [(0.40, False, P.HOLD), (0.25, False, P.LAND), (0.40, True, P.LAND)]
)
@pytest.mark.parametrize("hazard", [Hazard.FRAMES_FROZEN, Hazard.PAD_COPIES_VEHICLE, Hazard.CAMERA_TIME_WRONG])
def test_committed_landing_by_an_eye_that_can_not_be_believed_holds_while_it_can(
    make: Any, hazard, height_m, contact, after
):
    state = make.state(P.LAND)
    word = make.settled(state, committed=True, contact=contact, height_above_pad_m=height_m)
    seen = make.inputs(state, verdict=Verdict(hazard, "words"), guidance=word)
    assert step(state, seen, 100.0, make.config).state.phase is after


@pytest.mark.parametrize(("failure", "after"), [("hold", P.HOLD), ("return", P.RETURN), ("land", P.FALLBACK_LAND)])
def test_hazard_that_fails_the_mission_takes_the_configured_action(make: Any, failure, after):
    config = make.config.model_copy(update={"failure_action": failure})
    state = make.state(P.HOVER)
    result = step(state, make.inputs(state, verdict=Verdict(Hazard.FRAMES_STALE, "words")), 100.0, config)
    assert result.state.phase is after


def test_hazard_that_comes_with_a_command_is_acted_on_in_the_same_step(make: Any):
    state = make.state(P.HOVER)
    seen = make.inputs(state, verdict=Verdict(Hazard.BATTERY_LOW, "words"), command=make.command(Op.TRACK))
    result = step(state, seen, 100.0, make.config)
    assert result.state.phase is P.FALLBACK_LAND
    assert answers(result.answers) == [(OLD, C.CANCELLED), (NEW, C.IN_PROGRESS), (NEW, C.FAILED)]


def test_hazard_before_arming_ends_on_the_ground_and_asks_for_nothing(make: Any):
    state = make.state(P.TAKEOFF, takeoff_accepted=False, arm_asked=False)
    seen = make.inputs(state, vehicle=make.on_ground(), verdict=Verdict(Hazard.BATTERY_LOW, "words"))
    result = step(state, seen, 100.0, make.config)
    assert (result.state.phase, result.action) == (P.IDLE, None)


# ------------------------------------------------------------------------------------------------ pilot and disarm
OTHERS = [FlightMode.MANUAL, FlightMode.ALTITUDE, FlightMode.POSITION, FlightMode.MISSION, FlightMode.OTHER]


@pytest.mark.parametrize("phase", [*ACTIVE, *HANDED_OVER])
@pytest.mark.parametrize("mode", OTHERS)
@pytest.mark.parametrize("command", [None, *OperatorAction])
def test_pilot_in_another_mode_has_the_vehicle_at_once_whatever_the_phone_says(make: Any, phase, mode, command):
    state = make.state(phase)
    order = None if command is None else make.command(command)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=mode), command=order), 100.0, make.config)
    assert (result.state.phase, result.state.goal.kind, result.action) == (P.IDLE, GoalKind.NONE, None)
    assert result.reason is Reason.PILOT_TOOK_OVER
    assert result.texts[0].text == f"idle: {mode.value} mode by pilot or PX4, hands off"
    expected = [(OLD, C.CANCELLED)] if phase in ACTIVE else []
    refused = C.TEMPORARILY_REJECTED if command in BEGIN else C.DENIED
    assert answers(result.answers) == expected + ([] if command is None else [(NEW, refused)])


@pytest.mark.parametrize("phase", STEERING)
@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.RETURN, FlightMode.LAND, FlightMode.TAKEOFF])
def test_modes_of_px4_while_steering_are_not_ours_either(make: Any, phase, mode):
    state = make.state(phase)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=mode)), 100.0, make.config)
    assert (result.state.phase, result.action) == (P.IDLE, None)


@pytest.mark.parametrize("phase", [*ACTIVE, *HANDED_OVER])
def test_mode_unknown_to_telemetry_is_no_sign_of_the_pilot(make: Any, phase):
    state = make.state(phase)
    result = step(state, make.inputs(state, vehicle=make.vehicle(mode=FlightMode.UNKNOWN)), 100.0, make.config)
    assert result.reason is not Reason.PILOT_TOOK_OVER


@pytest.mark.parametrize("phase", [*STEERING, *HANDED_OVER])
def test_disarmed_in_flight_ends_the_mission(make: Any, phase):
    state = make.state(phase)
    result = step(state, make.inputs(state, vehicle=make.on_ground()), 100.0, make.config)
    assert (result.state.phase, result.reason, result.action) == (P.IDLE, Reason.DISARMED, None)
    assert answers(result.answers) == ([(OLD, C.FAILED)] if phase in STEERING else [])


def test_disarmed_in_a_committed_landing_is_the_aim(make: Any):
    state = make.state(P.LAND)
    seen = make.inputs(state, vehicle=make.on_ground(), guidance=make.settled(state, committed=True))
    result = step(state, seen, 100.0, make.config)
    assert (result.state.phase, result.reason) == (P.LANDED, Reason.TOUCHDOWN)
    assert answers(result.answers) == [(OLD, C.ACCEPTED)]


@pytest.mark.parametrize("action", BEGIN)
def test_command_in_the_step_of_the_touchdown_does_not_take_off_again(make: Any, action):
    state = make.state(P.LAND)
    word = make.settled(state, committed=True)
    seen = make.inputs(state, vehicle=make.on_ground(), guidance=word, command=make.command(action))
    result = step(state, seen, 100.0, make.config)
    assert (result.state.phase, result.action) == (P.LANDED, None)
    assert answers(result.answers) == [(OLD, C.ACCEPTED), (NEW, C.TEMPORARILY_REJECTED)]


def test_disarmed_on_the_word_of_an_older_goal_is_no_touchdown(make: Any):
    state = make.state(P.LAND)
    word = replace(make.settled(state, committed=True, contact=True), goal_number=6)
    result = step(state, make.inputs(state, vehicle=make.on_ground(), guidance=word), 100.0, make.config)
    assert result.state.phase is P.IDLE


# ---------------------------------------------------------------------------------------------- results of actions
@pytest.mark.parametrize("phase", list(Phase))
@pytest.mark.parametrize("action", list(AutopilotAction))
@pytest.mark.parametrize("ok", [True, False])
def test_result_that_nobody_waits_for_changes_nothing(make: Any, phase, action, ok):
    state = make.state(phase)
    quiet = step(state, make.inputs(state), 100.0, make.config)
    told = step(state, make.inputs(state, results=(ActionResult(action, ok, "late"),)), 100.0, make.config)
    assert (told.state.phase, told.state.refusals, told.action) == (
        quiet.state.phase,
        quiet.state.refusals,
        quiet.action,
    )


@pytest.mark.parametrize("phase", list(Phase))
def test_no_vehicle_leaves_the_state_alone(make: Any, phase):
    state = make.state(phase)
    seen = make.inputs(state, vehicle=None, track=None, track_usable=False, guidance=None)
    assert step(state, seen, 100.0, make.config).state == state
