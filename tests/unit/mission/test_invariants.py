"""What holds in every state that any sequence of inputs can lead to, likely or not."""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.config import MissionConfig
from app.messages import (
    ActionResult,
    AutopilotAction,
    CommandResult,
    FlightMode,
    GoalKind,
    GuidanceStatus,
    Hazard,
    LandedState,
    OperatorAction,
    OperatorCommand,
    PadTrack,
    Phase,
    VehicleState,
    Verdict,
)
from app.mission.machine import step
from app.mission.states import MissionInputs, MissionState, Reason, Transition

A, P = AutopilotAction, Phase
SILENT = {P.IDLE, P.LANDED, P.TAKEOFF, P.HOLD, P.RETURN, P.FALLBACK_LAND, P.SUSPENDED, P.DISARM}
STEERING = {P.SEARCH, P.HOVER, P.TRACK, P.LAND}
ACTIVE = STEERING | {P.TAKEOFF, P.PRECLAND}
ASKED_IN = {
    A.ARM: {P.TAKEOFF},
    A.TAKEOFF: {P.TAKEOFF},
    A.OFFBOARD: {P.SEARCH},
    A.HOLD: {P.HOLD, P.TAKEOFF},
    A.RETURN: {P.RETURN},
    A.LAND: {P.FALLBACK_LAND},
    A.PRECLAND: {P.PRECLAND},
    A.DISARM: {P.LAND, P.DISARM},
    A.FORCE_DISARM: {P.LAND},
}
CONFIG = MissionConfig(
    takeoff_timeout_s=5.0, search_timeout_s=8.0, hover_timeout_s=4.0, land_timeout_s=5.0, track_time_before_land_s=0.5
)

# Everything that a step sees, as independent draws, each with its harmless value first and often.
ARMED = st.sampled_from([True, True, True, True, True, True, True, False])
MODE = st.sampled_from([FlightMode.OFFBOARD] * 8 + [FlightMode.TAKEOFF, FlightMode.HOLD, *FlightMode])
LANDED = st.sampled_from([LandedState.IN_AIR] * 4 + list(LandedState))
HEIGHT = st.sampled_from([4.0, 2.5, 0.2, 0.0, 25.0])
COMMAND = st.one_of(
    *[st.none()] * 5, st.tuples(st.sampled_from(list(OperatorAction)), st.sampled_from([None, 3.0, 0.1]))
)
VERDICT = st.one_of(*[st.none()] * 20, st.sampled_from(list(Hazard)))
RESULT = st.sampled_from([True, True, True, None, None, False])
WORD = st.fixed_dictionaries(
    {
        "horizontal_error_m": st.sampled_from([0.05, 0.05, 0.05, 2.0, None]),
        "height_above_pad_m": st.sampled_from([None, 0.1, 2.5, 2.5, 2.5, -0.5]),
        "relative_speed_m_s": st.sampled_from([0.05, 0.05, 2.0, None]),
        "committed": st.sampled_from([False, False, True]),
        "contact": st.sampled_from([False, False, True]),
        "search_finished": st.sampled_from([False] * 9 + [True]),
        "climbed": st.booleans(),
    }
)
STEP = st.fixed_dictionaries(
    {
        "armed": ARMED,
        "mode": MODE,
        "landed": LANDED,
        "height_m": HEIGHT,
        "seen": st.sampled_from([True, True, True, False]),
        "usable": st.booleans(),
        "word": st.one_of(st.none(), WORD, WORD, WORD),
        "of_goal": st.sampled_from([0, 0, 0, 0, -1]),
        "command": COMMAND,
        "hazard": VERDICT,
        "result": RESULT,
        "may_force": st.booleans(),
        "dt_s": st.sampled_from([0.05, 0.05, 0.2, 1.0, 3.0]),
        "vehicle": st.sampled_from([True] * 15 + [False]),
        "px4_lands": st.booleans(),
        "pad_m_s": st.sampled_from([3.0, 0.0, 0.0]),
        "repeat": st.sampled_from([1, 1, 2, 5]),
    }
)


def inputs_of(
    state: MissionState, drawn: dict[str, Any], now_s: float, last_fix_s: float, number: int
) -> MissionInputs:
    vehicle = VehicleState(
        t_capture_s=now_s,
        pos_ned_m=np.array([0.0, 0.0, -drawn["height_m"]]),
        vel_ned_m_s=np.zeros(3),
        q_ned_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        armed=drawn["armed"],
        mode=drawn["mode"],
        landed=drawn["landed"],
        armable=True,
        local_position_ok=True,
        battery_fraction=0.8,
    )
    track = PadTrack(
        last_fix_s,
        np.zeros(3),
        np.array([drawn["pad_m_s"], 0.0, 0.0]),
        np.eye(6) * 0.01,
        0.0,
        0.0,
        last_fix_s,
        fixes_accepted=20,
    )
    word = drawn["word"]
    guidance = None if word is None else GuidanceStatus(now_s, state.goal.number + drawn["of_goal"], **word)
    order = drawn["command"]
    pending = state.pending
    answered = pending is not None and drawn["result"] is not None
    return MissionInputs(
        vehicle=vehicle if drawn["vehicle"] else None,
        track=track,
        track_usable=drawn["usable"],
        guidance=guidance,
        verdict=None if drawn["hazard"] is None else Verdict(drawn["hazard"], "a figure of 12% under its limit of 15%"),
        command=None if order is None else OperatorCommand(now_s, order[0], order[1], (255, 190), number),
        results=(ActionResult(pending, bool(drawn["result"])),) if answered and pending is not None else (),
        may_force_disarm=drawn["may_force"],
        px4_lands=drawn["px4_lands"],
    )


class Ledger:
    """What the phone was told, command by command."""

    def __init__(self) -> None:
        self.given: list[int] = []
        self.finals: Counter[int] = Counter()

    def take(self, seen: MissionInputs, result: Transition) -> None:
        if seen.command is not None:
            self.given.append(seen.command.number)
        for answer in result.answers:
            assert answer.number in self.given, "an answer to nobody"
            assert self.finals[answer.number] == 0, "an answer after the final one"
            assert 0 <= answer.progress_percent <= 100
            self.finals[answer.number] += answer.result is not CommandResult.IN_PROGRESS
        running = result.state.command
        waiting = [number for number in self.given if self.finals[number] == 0]
        assert waiting == ([] if running is None else [running.number]), "a command that nobody will answer"


def is_pilots(before: MissionState, seen: MissionInputs) -> bool:
    vehicle = seen.vehicle
    ours = {FlightMode.OFFBOARD, FlightMode.UNKNOWN}
    steering = before.phase in STEERING and before.offboard_seen
    if before.phase is P.PRECLAND and before.handed_over:
        if vehicle is not None and vehicle.landed is LandedState.ON_GROUND and before.committed_since_s is not None:
            ours = {FlightMode.OFFBOARD, FlightMode.PRECLAND, FlightMode.UNKNOWN}
            return vehicle.armed and vehicle.mode not in ours
        return vehicle is not None and vehicle.armed and vehicle.mode not in {FlightMode.PRECLAND, FlightMode.UNKNOWN}
    return steering and vehicle is not None and vehicle.armed and vehicle.mode not in ours


def check(before: MissionState, seen: MissionInputs, result: Transition) -> None:
    after, action = result.state, result.action
    assert (after.goal.kind is GoalKind.NONE) == (after.phase in SILENT)
    assert (after.command is None) or after.phase in ACTIVE | {P.SUSPENDED}
    assert action is None or after.phase in ASKED_IN[action]
    if action is A.FORCE_DISARM:
        assert seen.may_force_disarm and seen.guidance is not None and seen.guidance.committed
        assert seen.guidance.goal_number == before.goal.number
    if action is A.ARM:
        assert not before.arm_asked or result.reason is Reason.COMMANDED, "a second arming for one order"
    if action in (A.DISARM, A.FORCE_DISARM) and after.phase is P.LAND:
        assert seen.guidance is not None and seen.guidance.contact, "a disarm in the air"
    if after.phase is P.LAND and before.phase is not P.LAND:
        assert seen.track_usable or result.reason is Reason.RESUMED, "a landing without a fresh track"
    if action is not None:
        assert after.pending is action
        assert before.pending is None or seen.results or result.reason is not None, "two actions under way"
    if is_pilots(before, seen):
        assert (after.phase, after.goal.kind, action) == (P.IDLE, GoalKind.NONE, None)
    if seen.vehicle is not None and not seen.vehicle.armed:
        assert after.phase not in STEERING | {P.PRECLAND}
    if seen.vehicle is None:
        assert action is None
    assert after.goal.number >= before.goal.number
    assert after.goal.number > before.goal.number or after.goal is before.goal
    assert after.phase is before.phase or (result.reason is not None and result.texts)
    assert after.home_ned_m is None if after.phase in (P.IDLE, P.LANDED) else True
    for text in result.texts:
        assert len(text.text) <= 50 and text.text.isascii() and text.text.isprintable()


@settings(max_examples=120, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(script=st.lists(STEP, min_size=1, max_size=60))
def test_any_sequence_of_inputs_keeps_every_invariant(script: list[dict[str, Any]]):
    state, now_s, last_fix_s, number = MissionState(), 100.0, 100.0, 0
    ledger = Ledger()
    for drawn in script:
        for turn in range(drawn["repeat"]):
            now_s += drawn["dt_s"]
            last_fix_s = now_s if drawn["seen"] else last_fix_s
            number += 1
            once = drawn if turn == 0 else {**drawn, "command": None}
            seen = inputs_of(state, once, now_s, last_fix_s, number)
            result = step(state, seen, now_s, CONFIG)
            ledger.take(seen, result)
            check(state, seen, result)
            state = result.state


# ------------------------------------------------------------------------------------------------- a toy of a vehicle
class Toy:
    """A vehicle, a pad, a controller and a link, as simple as can be, and a fate that throws a spanner in now and then.
    The pad stands still where PX4 is to land by itself, and drives where it isn't.

    Actions take 10 ms to 1 s, some are refused. Mode and arming show 0.1 to 1 s late, as on the real link.
    """

    def __init__(self, seed: int, trouble: float, *, px4_lands: bool = False) -> None:
        self.px4_lands = px4_lands
        self.rng = random.Random(seed)
        self.trouble = trouble
        self.now_s = 100.0
        self.armed, self.mode, self.height_m = False, FlightMode.HOLD, 0.0
        self.shown: list[tuple[float, bool, FlightMode]] = [(0.0, False, FlightMode.HOLD)]
        self.under_way: list[tuple[float, AutopilotAction]] = []
        self.last_fix_s = -1e9
        self.goal_since_s, self.goal_number = 0.0, -1
        self.forced_in_air = 0

    def happens(self, a_second: float) -> bool:
        return self.rng.random() < self.trouble * a_second * DT_S

    def request(self, action: AutopilotAction) -> None:
        self.under_way.append((self.now_s + self.rng.uniform(0.01, 1.0), action))

    def _obey(self, action: AutopilotAction) -> bool:
        if self.rng.random() < 0.1 * self.trouble:
            return False
        if action is A.ARM:
            self.armed = True
        elif action is A.DISARM and self.height_m > 0.05:
            return False
        elif action in (A.DISARM, A.FORCE_DISARM):
            self.forced_in_air += self.height_m > 0.3
            self.armed = False
        else:
            self.mode = FlightMode(action.value)
        return True

    def fly(self, state: MissionState) -> tuple[ActionResult, ...]:
        """Move on by DT_S; the answers that came."""
        self.now_s += DT_S
        if state.goal.number != self.goal_number:
            self.goal_number, self.goal_since_s = state.goal.number, self.now_s
        results = [ActionResult(a, self._obey(a)) for t, a in self.under_way if t <= self.now_s]
        self.under_way = [(t, a) for t, a in self.under_way if t > self.now_s]
        if self.mode is FlightMode.OFFBOARD and state.goal.kind is GoalKind.NONE:
            self.mode = FlightMode.HOLD  # nobody sends setpoints: PX4's failsafe
        if self.armed and self.happens(0.01):
            self.mode = self.rng.choice([FlightMode.POSITION, FlightMode.MANUAL, FlightMode.LAND])
        down = {FlightMode.LAND: 0.0, FlightMode.PRECLAND: 0.0}
        target_m = {**down, FlightMode.TAKEOFF: 4.0, FlightMode.OFFBOARD: state.goal.height_m}.get(self.mode)
        if self.armed and target_m is not None:
            self.height_m += max(-0.8 * DT_S, min(1.0 * DT_S, target_m - self.height_m))
        if self.mode is FlightMode.TAKEOFF and self.height_m >= 3.99:
            self.mode = FlightMode.HOLD
        if self.mode in down and self.height_m <= 0.0:
            self.armed = False
        if self.shown[-1][1:] != (self.armed, self.mode):
            lag_s = self.rng.uniform(0.1, 1.0)
            self.shown.append((max(self.now_s + lag_s, self.shown[-1][0]), self.armed, self.mode))
        if self.height_m > 0.3 and not self.happens(2.0) and self.now_s - self.last_fix_s < 2.0:
            self.last_fix_s = self.now_s
        if self.height_m > 2.0 and self.rng.random() < 0.2 * DT_S:
            self.last_fix_s = self.now_s
        return tuple(results)

    def look(
        self, state: MissionState, command: OperatorCommand | None, results: tuple[ActionResult, ...]
    ) -> MissionInputs:
        _, armed, mode = [entry for entry in self.shown if entry[0] <= self.now_s][-1]
        for_s = self.now_s - self.goal_since_s
        contact = state.phase is P.LAND and self.height_m <= 0.02
        drawn = {
            "armed": armed,
            "mode": mode,
            "landed": LandedState.ON_GROUND if self.height_m <= 0.02 else LandedState.IN_AIR,
            "height_m": self.height_m,
            "usable": self.now_s - self.last_fix_s < 0.5,
            "word": {
                "horizontal_error_m": 0.1 if for_s > 2.0 else 1.0,
                "height_above_pad_m": self.height_m,
                "relative_speed_m_s": 0.1,
                "committed": state.phase in (P.LAND, P.PRECLAND) and self.height_m < 0.45,
                "contact": contact,
                "search_finished": state.goal.kind is GoalKind.SEARCH and for_s > 60.0,
                "climbed": self.height_m > 3.7,
            },
            "of_goal": 0,
            "command": None,
            "hazard": self.rng.choice(list(Hazard)) if self.happens(0.02) else None,
            "result": None,
            "may_force": contact and self.rng.random() < 0.1,
            "vehicle": True,
            "px4_lands": self.px4_lands,
            "pad_m_s": 0.0 if self.px4_lands else 3.0,
        }
        seen = inputs_of(state, drawn, self.now_s, self.last_fix_s, 0)
        return replace(seen, command=command, results=results)


DT_S = 0.05


def walk(toy: Toy, seconds: float, commands_a_second: float) -> tuple[Ledger, set[Phase], MissionState]:
    """Fly with random commands, then as long again with none; every step is checked."""
    ledger, visited, state = Ledger(), set(), MissionState(since_s=toy.now_s)
    config = MissionConfig()
    for turn in range(round(2 * seconds / DT_S)):
        ordered = turn * DT_S < seconds and toy.rng.random() < commands_a_second * DT_S
        action = toy.rng.choice([OperatorAction.LAND, OperatorAction.LAND, *OperatorAction])
        command = OperatorCommand(toy.now_s, action, None, (255, 190), turn) if ordered else None
        seen = toy.look(state, command, toy.fly(state))
        result = step(state, seen, toy.now_s, config)
        ledger.take(seen, result)
        check(state, seen, result)
        state = result.state
        visited.add(state.phase)
        if result.action is not None:
            toy.request(result.action)
    return ledger, visited, state


@pytest.mark.parametrize("px4_lands", [False, True], ids=["velocity", "px4-precland"])
@pytest.mark.parametrize("seed", range(5))
def test_toy_flight_with_trouble_keeps_every_invariant_and_answers_every_command(seed: int, px4_lands: bool):
    toy = Toy(seed, trouble=1.0, px4_lands=px4_lands)
    ledger, _, state = walk(toy, seconds=300.0, commands_a_second=0.05)
    assert len(ledger.given) >= 5
    assert state.command is None and all(ledger.finals[number] == 1 for number in ledger.given)
    assert toy.forced_in_air == 0


def test_toy_flights_with_trouble_reach_every_phase():
    toys = [Toy(seed, trouble=1.0, px4_lands=seed % 2 == 0) for seed in range(20, 28)]
    visited = set().union(*(walk(toy, 200.0, 0.05)[1] for toy in toys))
    assert visited == set(Phase)


@pytest.mark.parametrize(
    ("px4_lands", "landing"), [(False, P.LAND), (True, P.PRECLAND)], ids=["velocity", "px4-precland"]
)
@pytest.mark.parametrize("seed", range(3))
def test_toy_flight_without_trouble_lands_on_the_first_command(seed: int, px4_lands: bool, landing: Phase):
    toy, state, told = Toy(seed, trouble=0.0, px4_lands=px4_lands), MissionState(), []
    command: OperatorCommand | None = OperatorCommand(toy.now_s, OperatorAction.LAND, None, (255, 190), 1)
    phases = [state.phase]
    while toy.now_s < 400.0 and state.phase is not P.LANDED:
        result = step(state, toy.look(state, command, toy.fly(state)), toy.now_s, MissionConfig())
        command, state = None, result.state
        told += [answer.result for answer in result.answers]
        phases += [state.phase] if state.phase is not phases[-1] else []
        if result.action is not None:
            toy.request(result.action)
    assert phases == [P.IDLE, P.TAKEOFF, P.SEARCH, P.HOVER, P.TRACK, landing, P.LANDED]
    assert told == [CommandResult.IN_PROGRESS] * 5 + [CommandResult.ACCEPTED]
