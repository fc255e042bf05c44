"""The mission state machine: `step` takes what is remembered and what is seen, and decides. Pure.

Guards come first, in this order: what the results of actions say, the end of the flight, the pilot, the phone's hold
and abort, safety. Then a `match` over the phase. The pilot always wins: the moment PX4's mode is no longer the one
that Alight asked for, Alight stops commanding and says so.
"""

from __future__ import annotations

from dataclasses import replace

from app.config import MissionConfig
from app.mission.commands import take_command
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
    state = take_results(state, inputs)
    ended = end_of_flight(state, inputs, now_s) or pilot(state, inputs, now_s)
    if ended is not None:
        # A command that came in the same instant is answered by the state that the mission is in now.
        told = take_command(ended.state, inputs, now_s, config)
        return ended if told is None else _both(ended, told)
    return (
        take_command(state, inputs, now_s, config)
        or safety(state, inputs, now_s, config)
        or run_phase(state, inputs, now_s, config)
    )


def _both(first: Transition, second: Transition) -> Transition:
    return replace(
        second,
        reason=second.reason or first.reason,
        answers=first.answers + second.answers,
        texts=first.texts + second.texts,
    )
