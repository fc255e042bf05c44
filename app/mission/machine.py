"""The mission state machine: `step` takes what is remembered and what is seen, and decides. Pure.

Guards come first, in this order: what the results of actions say, the end of the flight, the pilot, the phone,
safety. Then a `match` over the phase. The pilot always wins: the moment PX4's mode is no longer the one that Alight
asked for, Alight stops commanding and says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.config import MissionConfig
from app.mission.commands import refuse_beginning, take_command
from app.mission.endings import wind_down
from app.mission.guards import end_of_flight, pilot, safety, take_results
from app.mission.phases import run_phase
from app.mission.states import MissionInputs, MissionState, Transition


def step(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    """Decide.

    Args:
        state: What the last step returned.
        inputs: What is seen now.
        now_s: The time.
        config: [mission].
    """
    state = _follow_frame(state, inputs)
    decided = _decide(state, inputs, now_s, config)
    dropped = _still_pending(state, inputs) and decided.state.pending is not state.pending
    if dropped and decided.action is None:
        decided = replace(decided, cancels=True)
    goal = decided.state.goal
    if goal.number == state.goal.number or inputs.vehicle is None:
        return decided
    stamped = replace(goal, frame_s=inputs.vehicle.t_capture_s)
    return replace(decided, state=replace(decided.state, goal=stamped))


def _still_pending(state: MissionState, inputs: MissionInputs) -> bool:
    """Whether an action is under way whose answer has not come with these inputs."""
    return state.pending is not None and all(result.action is not state.pending for result in inputs.results)


def _follow_frame(state: MissionState, inputs: MissionInputs) -> MissionState:
    """Carry home and the goal's anchor over a jump of PX4's local frame; the pad's way is measured anew."""
    vehicle, before = inputs.vehicle, state.jumps.vehicle
    if vehicle is None:
        return state
    state = replace(state, jumps=state.jumps.see(vehicle))
    if before is None or vehicle.frame_resets == before.frame_resets:
        return state
    jump_m = state.jumps.since(before.t_capture_s)
    goal = replace(state.goal, anchor_ned_m=state.goal.anchor_ned_m + jump_m, frame_s=vehicle.t_capture_s)
    home = None if state.home_ned_m is None else np.array(state.home_ned_m + jump_m)
    return replace(state, goal=goal, home_ned_m=home, watch=None)


def _decide(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    state = take_results(state, inputs, now_s)
    if inputs.stopping and state.stopping_since_s is None:
        state = replace(state, stopping_since_s=now_s)
    ended = end_of_flight(state, inputs, now_s) or pilot(state, inputs, now_s, config)
    if ended is not None:
        # Whoever sent a command in this instant didn't know: nothing begins on the heels of a pilot or a touchdown.
        told = refuse_beginning(ended, inputs) or take_command(ended.state, inputs, now_s, config)
        if told is None:
            return ended
        return replace(ended, answers=ended.answers + told.answers, texts=ended.texts + told.texts)
    told = take_command(state, inputs, now_s, config)
    hazard = safety(state if told is None else told.state, inputs, now_s, config)
    if told is None:
        return hazard or wind_down(state, inputs, now_s, config) or run_phase(state, inputs, now_s, config)
    if hazard is None:
        return told
    return replace(hazard, answers=told.answers + hazard.answers, texts=hazard.texts + told.texts)
