"""PX4's own precision landing: when it is begun and refused, how it is handed over, and what ends it."""

from __future__ import annotations

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
from app.mission.machine import step
from app.mission.precland import speed_if_moving_m_s
from app.mission.states import Reason

A, P = AutopilotAction, Phase
STEADY = {"since_s": 90.0, "steady_since_s": 95.0}
"""Of a TRACK that has been settled for long enough."""


def landing(make: Any, **changes: Any) -> Any:
    """PX4 flies its precision landing."""
    return make.state(P.PRECLAND, **{"handed_over": True, **changes})


def seen(make: Any, state: Any, mode: FlightMode = FlightMode.PRECLAND, **changes: Any) -> Any:
    return make.inputs(state, **{"vehicle": make.vehicle(mode=mode), "px4_lands": True, **changes})


@pytest.mark.parametrize(("px4_lands", "after"), [(False, P.LAND), (True, P.PRECLAND)])
def test_steady_track_leads_to_the_landing_of_the_configured_method(make: Any, px4_lands, after):
    state = make.state(P.TRACK, **STEADY)
    result = step(state, make.inputs(state, px4_lands=px4_lands), 100.0, make.config)
    assert result.state.phase is after
    assert result.state.goal.kind.value == after.value


def test_precland_stays_at_its_height_until_px4_flies(make: Any):
    state = make.state(P.TRACK, **STEADY)
    word = make.settled(state, height_above_pad_m=2.3)
    result = step(state, make.inputs(state, px4_lands=True, guidance=word), 100.0, make.config)
    assert (result.state.goal.kind, result.state.goal.height_m) == (GoalKind.PRECLAND, 2.3)


@pytest.mark.parametrize(
    ("speed_m_s", "sigma_m_s", "moves"),
    [(0.0, 0.1, False), (0.29, 0.0, False), (0.31, 0.0, True), (0.49, 0.1, False), (0.51, 0.1, True), (3.7, 0.3, True)],
)
def test_pad_moves_when_its_speed_stands_out_of_its_error(make: Any, speed_m_s, sigma_m_s, moves):
    track = make.track(
        vel_ned_m_s=np.array([0.6 * speed_m_s, 0.8 * speed_m_s, 0.0]), covariance=np.eye(6) * sigma_m_s**2
    )
    found = speed_if_moving_m_s(track)
    assert (found is not None) is moves
    assert found is None or found == pytest.approx(speed_m_s)


@pytest.mark.parametrize("phase", [P.TRACK, P.PRECLAND])
@pytest.mark.parametrize("speed_m_s", [0.4, 1.2, 3.7])
def test_pad_that_moves_is_refused_in_words_with_its_speed(make: Any, phase, speed_m_s):
    state = make.state(P.TRACK, **STEADY) if phase is P.TRACK else landing(make)
    result = watched(make, state, speed_m_s, speed_m_s)
    assert (result.state.phase, result.reason) == (P.HOLD, Reason.PAD_MOVES)
    assert result.texts[0].text == f"hold: pad moves at {speed_m_s:.1f} m/s, PX4 can't follow it"
    assert [answer.result for answer in result.answers] == [CommandResult.FAILED]


@pytest.mark.parametrize("phase", [P.TRACK, P.PRECLAND])
@pytest.mark.parametrize(("told_m_s", "gone_m_s"), [(0.7, 0.13), (0.1, 0.7), (0.7, 0.0)])
def test_pad_that_only_seems_to_move_by_an_error_of_px4s_is_landed_on(make: Any, phase, told_m_s, gone_m_s):
    """PX4's velocity was 0.7 m/s wrong while it sank to the pad, its position drifted by 0.13 m/s; or the other way."""
    state = make.state(P.TRACK, **STEADY) if phase is P.TRACK else landing(make)
    assert watched(make, state, told_m_s, gone_m_s).state.phase is P.PRECLAND


def test_jump_of_px4s_frame_is_no_way_that_the_pad_made(make: Any):
    """It jumps by 2 m half way through: of both its halves none is long enough to tell a speed."""
    state = landing(make)
    for now_s, north_m, resets in ((97.0, 1.0, 0), (98.5, 1.0, 0), (98.6, 3.0, 1), (100.0, 3.0, 1)):
        track = make.track(
            t_capture_s=now_s, pos_ned_m=np.array([north_m, 2.0, 0.0]), vel_ned_m_s=np.array([1.0, 0, 0])
        )
        vehicle = make.vehicle(
            mode=FlightMode.PRECLAND, t_capture_s=now_s, frame_resets=resets, pos_ned_m=np.array([north_m, 2.0, -3.0])
        )
        state = step(state, seen(make, state, track=track, vehicle=vehicle), now_s, make.config).state
    assert state.phase is P.PRECLAND


def watched(make: Any, state: Any, told_m_s: float, gone_m_s: float) -> Any:
    """What the last of eleven looks at a pad leads to, half a second apart."""
    for k in range(11):
        now_s = 95.0 + 0.5 * k
        track = make.track(
            t_capture_s=now_s,
            t_last_fix_s=now_s,
            pos_ned_m=np.array([1.0 + gone_m_s * (now_s - 95.0), 2.0, 0.0]),
            vel_ned_m_s=np.array([told_m_s, 0.0, 0.0]),
            covariance=np.eye(6) * 1e-4,
        )
        result = step(state, seen(make, state, state_mode(state.phase), track=track), now_s, make.config)
        if result.reason is Reason.PAD_MOVES:
            break
        state = result.state
    return result


def state_mode(phase: Phase) -> FlightMode:
    return FlightMode.PRECLAND if phase is P.PRECLAND else FlightMode.OFFBOARD


@pytest.mark.parametrize(("now_s", "asked"), [(95.4, None), (95.6, A.PRECLAND)])
def test_px4_is_asked_once_it_has_heard_of_the_target_for_half_a_second(make: Any, now_s, asked):
    state = landing(make, handed_over=False)
    assert step(state, seen(make, state, FlightMode.OFFBOARD), now_s, make.config).action is asked


def test_px4_has_taken_over_when_it_accepted_and_shows_the_mode(make: Any):
    state = landing(make, handed_over=False, pending=A.PRECLAND, asked=A.PRECLAND, asked_s=99.0)
    result = step(state, seen(make, state, results=(ActionResult(A.PRECLAND, True),)), 100.0, make.config)
    assert result.state.handed_over
    assert result.state.phase is P.PRECLAND


def test_px4_that_refuses_three_times_leaves_the_vehicle_in_the_failure_action(make: Any):
    state = landing(make, handed_over=False, asked=A.PRECLAND, asked_s=98.0, refusals=3)
    result = step(state, seen(make, state, FlightMode.OFFBOARD), 100.0, make.config)
    assert (result.state.phase, result.reason) == (P.HOLD, Reason.REFUSED_BY_AUTOPILOT)
    assert "PX4 refused its precision landing" in result.texts[0].text


@pytest.mark.parametrize("mode", [FlightMode.POSITION, FlightMode.HOLD, FlightMode.LAND, FlightMode.RETURN])
@pytest.mark.parametrize("committed", [False, True])
def test_pilot_takes_over_from_px4s_precision_landing(make: Any, mode, committed):
    state = landing(make)
    word = make.settled(state, committed=committed)
    result = step(state, seen(make, state, mode, guidance=word), 100.0, make.config)
    assert (result.state.phase, result.reason, result.action) == (P.IDLE, Reason.PILOT_TOOK_OVER, None)
    assert result.state.goal.kind is GoalKind.NONE


@pytest.mark.parametrize(("order", "after"), [(OperatorAction.HOLD, P.HOLD), (OperatorAction.ABORT, P.RETURN)])
def test_hold_and_abort_end_px4s_precision_landing(make: Any, order, after):
    state = landing(make)
    result = step(state, seen(make, state, command=make.command(order)), 100.0, make.config)
    assert result.state.phase is after
    following = step(result.state, seen(make, result.state), 100.05, make.config)
    assert following.action is {P.HOLD: A.HOLD, P.RETURN: A.RETURN}[after]


@pytest.mark.parametrize(
    ("hazard", "committed", "after"),
    [
        (Hazard.BATTERY_LOW, False, P.FALLBACK_LAND),
        (Hazard.FRAMES_STALE, False, P.HOLD),
        (Hazard.FRAMES_STALE, True, P.PRECLAND),
        (Hazard.LINK_LOST, True, P.SUSPENDED),
    ],
)
def test_safety_stays_in_force_until_the_commit(make: Any, hazard, committed, after):
    state = landing(make)
    word = make.settled(state, committed=committed)
    result = step(state, seen(make, state, guidance=word, verdict=Verdict(hazard, "words")), 100.0, make.config)
    assert result.state.phase is after


@pytest.mark.parametrize("order", [OperatorAction.TRACK, OperatorAction.SEARCH])
def test_other_aim_takes_the_vehicle_back_through_offboard(make: Any, order):
    state = landing(make)
    result = step(state, seen(make, state, command=make.command(order)), 100.0, make.config)
    assert result.state.phase is P.SEARCH
    assert not result.state.offboard_seen
    # PX4 still shows its own mode: that is no pilot, and offboard is asked for.
    following = step(result.state, seen(make, result.state), 100.6, make.config)
    assert following.action is A.OFFBOARD


def test_pad_that_is_lost_above_the_commit_is_searched_for_through_offboard(make: Any):
    state = landing(make)
    result = step(state, seen(make, state, track=make.track(t_last_fix_s=97.9)), 100.0, make.config)
    assert (result.state.phase, result.reason, result.state.tries) == (P.SEARCH, Reason.PAD_LOST, 1)
    assert result.state.goal.kind is GoalKind.CLIMB
    following = step(result.state, seen(make, result.state), 100.6, make.config)
    assert following.action is A.OFFBOARD


@pytest.mark.parametrize(
    ("height_m", "off_m", "committed", "after"),
    [
        (0.79, 0.41, False, P.SEARCH),
        (0.3, 0.7, False, P.SEARCH),
        (0.81, 0.7, False, P.PRECLAND),
        (0.79, 0.39, False, P.PRECLAND),
        (0.3, 0.7, True, P.PRECLAND),
    ],
)
def test_px4_that_sinks_low_beside_the_pad_goes_round(make: Any, height_m, off_m, committed, after):
    state = landing(make)
    word = make.settled(state, height_above_pad_m=height_m, horizontal_error_m=off_m, committed=committed)
    result = step(state, seen(make, state, guidance=word), 100.0, make.config)
    assert result.state.phase is after
    if after is P.SEARCH:
        assert (result.reason, result.state.goal.kind, result.state.tries) == (Reason.PAD_MISSED, GoalKind.CLIMB, 1)


def test_landing_that_takes_too_long_goes_round(make: Any):
    state = landing(make, since_s=100.0 - make.config.land_timeout_s - 0.1)
    assert step(state, seen(make, state), 100.0, make.config).reason is Reason.TIMED_OUT


@pytest.mark.parametrize(
    ("committed", "after", "told"), [(True, P.LANDED, CommandResult.ACCEPTED), (False, P.IDLE, CommandResult.FAILED)]
)
def test_disarming_by_px4_is_a_landing_only_on_the_pad(make: Any, committed, after, told):
    state = landing(make)
    word = make.settled(state, committed=committed)
    vehicle = make.on_ground(mode=FlightMode.PRECLAND)
    result = step(state, seen(make, state, vehicle=vehicle, guidance=word), 100.0, make.config)
    assert result.state.phase is after
    assert [answer.result for answer in result.answers] == [told]


@pytest.mark.parametrize(
    ("landed", "committed", "mode", "after"),
    [
        (LandedState.ON_GROUND, True, FlightMode.OFFBOARD, P.PRECLAND),
        (LandedState.ON_GROUND, True, FlightMode.POSITION, P.IDLE),
        (LandedState.ON_GROUND, False, FlightMode.OFFBOARD, P.IDLE),
        (LandedState.IN_AIR, True, FlightMode.OFFBOARD, P.IDLE),
    ],
)
def test_mode_that_px4_goes_back_to_as_it_disarms_on_the_pad_is_no_pilot(make: Any, landed, committed, mode, after):
    state = landing(make, committed_since_s=98.0 if committed else None)
    word = make.settled(state, committed=committed, contact=True)
    vehicle = make.vehicle(mode=mode, landed=landed)
    result = step(state, seen(make, state, vehicle=vehicle, guidance=word), 100.0, make.config)
    assert (result.state.phase, result.action) == (after, None)


def test_landing_that_is_committed_and_never_disarmed_is_left_to_px4s_plain_landing(make: Any):
    state = landing(make, committed_since_s=69.0)
    word = make.settled(state, committed=True)
    assert step(state, seen(make, state, guidance=word), 100.0, make.config).state.phase is P.FALLBACK_LAND


def test_commit_that_is_taken_back_counts_from_anew(make: Any):
    state = landing(make, committed_since_s=79.0)
    taken_back = step(state, seen(make, state), 100.0, make.config).state
    assert (taken_back.phase, taken_back.committed_since_s) == (P.PRECLAND, None)


# -------------------------------------------------------------------------------------- what is on its way to PX4 shows
def asked(make: Any) -> Any:
    """PX4's landing was asked for in the last step, and doesn't show yet."""
    state = make.state(P.PRECLAND, handed_over=False, since_s=99.0, entry_mode=FlightMode.OFFBOARD)
    result = step(state, seen(make, state, FlightMode.OFFBOARD), 100.0, make.config)
    assert result.action is A.PRECLAND
    return result.state


@pytest.mark.parametrize("action", [OperatorAction.TRACK, OperatorAction.SEARCH])
def test_phone_that_wants_no_landing_while_it_is_on_its_way_gets_none(make: Any, action):
    """The mode that was asked for a moment ago is no pilot: offboard is asked for after it."""
    changed = step(
        asked(make), seen(make, asked(make), FlightMode.OFFBOARD, command=make.command(action)), 100.1, make.config
    ).state
    shows = step(changed, seen(make, changed, track_usable=False, track=None), 100.2, make.config)
    assert shows.state.phase is P.SEARCH
    later = step(shows.state, seen(make, shows.state, track_usable=False, track=None), 100.7, make.config)
    assert (later.state.phase, later.action) == (P.SEARCH, A.OFFBOARD)


def test_pad_lost_while_the_landing_is_on_its_way_is_gone_round_for(make: Any):
    state, gone = asked(make), make.track(t_last_fix_s=98.0)
    lost = step(state, seen(make, state, FlightMode.OFFBOARD, track=gone), 100.1, make.config).state
    assert (lost.phase, lost.goal.kind) == (P.SEARCH, GoalKind.CLIMB)
    shows = step(lost, seen(make, lost, track=gone, track_usable=False), 100.2, make.config)
    assert shows.state.phase is P.SEARCH


@pytest.mark.parametrize(
    ("phase", "own", "action", "mode"),
    [(P.PRECLAND, A.PRECLAND, A.HOLD, FlightMode.PRECLAND), (P.RETURN, A.RETURN, A.HOLD, FlightMode.RETURN)],
)
def test_hold_is_sent_although_the_mode_asked_for_before_shows_first(make: Any, phase, own, action, mode):
    state = make.state(phase, handed_over=False, since_s=99.0, entry_mode=FlightMode.OFFBOARD)
    result = step(state, seen(make, state, FlightMode.OFFBOARD), 100.0, make.config)
    assert result.action is own
    order = make.command(OperatorAction.HOLD)
    held = step(result.state, seen(make, result.state, FlightMode.OFFBOARD, command=order), 100.05, make.config)
    assert [answer.result for answer in held.answers][-1] is CommandResult.ACCEPTED
    shows = step(held.state, seen(make, held.state, mode), 100.1, make.config)
    assert (shows.state.phase, shows.action) == (P.HOLD, action)
