"""The mission state machine: `step` takes what is remembered and what is seen, and decides. Pure.

Guards come first, in this order: what the results of actions say, the end of the flight, the pilot, the phone's hold
and abort, safety. Then a `match` over the phase. The pilot always wins: the moment PX4's mode is no longer the one
that Alight asked for, Alight stops commanding and says so.
"""

from __future__ import annotations

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
    return (
        end_of_flight(state, inputs, now_s)
        or pilot(state, inputs, now_s)
        or take_command(state, inputs, now_s, config)
        or safety(state, inputs, now_s, config)
        or run_phase(state, inputs, now_s, config)
    )
