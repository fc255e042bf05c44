"""When an approach has failed, and what is done then: climb, and search again. Pure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from app.config import MissionConfig
from app.messages import GoalKind, Phase, Severity
from app.mission.states import MissionInputs, MissionState, Reason, Transition
from app.mission.transitions import fail, go, guidance_of, mode_of, numbered

LOST_AFTER_S = 2.0
"""Guidance closes in no more after half a second and coasts along; a pad unseen for so long is searched for anew."""
ANCHOR_AHEAD_MAX_S = 4.0
"""A pad that was last seen longer ago is not expected where its last velocity would have taken it."""


DRIVES_M_S = 1.0
"""A pad at this speed is expected to drive on, and the search goes along with it for `search_along_s`."""


def out_of_reach(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """Give up a pad that drives away faster than the vehicle may fly, and say so; else None."""
    guidance = guidance_of(state, inputs)
    if guidance is None or guidance.pad_too_fast_m_s is None or guidance.committed:
        return None
    words = f"{Reason.PAD_TOO_FAST.value}: {guidance.pad_too_fast_m_s:.1f} m/s"
    return fail(state, Reason.PAD_TOO_FAST, now_s, config, words)


def lost(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """Go round if the pad was not seen for LOST_AFTER_S, give up if it can't be followed; else None."""
    track = inputs.track
    if track is not None and now_s - track.t_last_fix_s <= LOST_AFTER_S:
        return out_of_reach(state, inputs, now_s, config)
    return go_round(state, inputs, Reason.PAD_LOST, now_s, config)


def go_round(
    state: MissionState, inputs: MissionInputs, reason: Reason, now_s: float, config: MissionConfig
) -> Transition:
    """Climb to the search height over where the pad is expected, and search again; a limited number of times. One that
    flies higher than that already searches from there.
    """
    if state.tries + 1 >= config.landing_tries:
        return fail(state, Reason.TRIES_USED_UP, now_s, config, f"{Reason.TRIES_USED_UP.value}: {reason.value}")
    vehicle, track = inputs.vehicle, inputs.track
    if track is not None:
        track = replace(track, pos_ned_m=track.pos_ned_m + state.jumps.since(track.t_last_fix_s))
    anchor = np.zeros(3) if vehicle is None else np.array(vehicle.pos_ned_m)
    drift = (0.0, 0.0)
    if track is not None:
        expected = track.at(min(now_s, track.t_capture_s + ANCHOR_AHEAD_MAX_S))
        anchor = np.array(expected.pos_ned_m)
        north, east, _ = expected.vel_ned_m_s.tolist()
        if math.hypot(north, east) > DRIVES_M_S and now_s - track.t_last_fix_s < ANCHOR_AHEAD_MAX_S:
            drift = (north, east)
    if state.home_ned_m is not None and track is None:
        anchor[2] = state.home_ned_m[2]
    height_m = config.search_height_m
    if vehicle is not None:  # over trees, the phone may have had it track from higher up
        height_m = max(height_m, float(anchor[2] - vehicle.pos_ned_m[2]))
    goal = numbered(state, GoalKind.CLIMB, height_m, anchor, drift)
    climb = go(
        state,
        Phase.SEARCH,
        reason,
        now_s,
        goal=goal,
        severity=Severity.WARNING,
        tries=state.tries + 1,
        ground_known=state.ground_known or track is not None,
        left_behind_s=track.t_last_fix_s if track is not None and any(drift) else None,
    )
    if state.phase is not Phase.PRECLAND:
        return climb
    # PX4 flies, or is about to: offboard comes first.
    return replace(climb, state=replace(climb.state, offboard_seen=False, entry_mode=mode_of(state)))
