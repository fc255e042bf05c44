"""What is done when the pad is not where a search looks for it. Pure.

A pad that drove when it was lost is looked for where it would be if it drove on. If it isn't there it has stopped, or
turned off: the search turns back along its way, over every place where it can have stopped, to where it was last seen.
Else it would go on with a pad that stands far behind for as long as a pattern takes.

When the pattern has been flown out, the same is flown lower.

From lower down the pad is larger in the image: one that half a shadow covers needs more pixels than it has from the
search height. Height, spacing and radius shrink alike, so each pass sees its ground under the same angles as the one
before, takes less time, and looks nearer to the anchor, where the pad is likeliest. The pattern begins at the anchor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.config import MissionConfig
from app.messages import GoalKind, OperatorText
from app.mission.states import MissionInputs, MissionState, Reason, Transition
from app.mission.transitions import anchor_of, fail, guidance_of, numbered

WORTH_SHARE = 0.9
"""A pass that is not lower than this share of the last one's height shows the pad no larger to speak of."""


def search_lower(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition:
    """The next pass, back over the anchor and lower; or the end of the mission, if there is none.

    There is none over ground whose height is only assumed, and none lower than `search_height_min_m` over the anchor.
    """
    if state.left_behind_s is not None:
        return _back(state, inputs, state.left_behind_s, now_s)
    goal, passes = state.goal, state.search_passes + 1
    height_m = max(config.search_height_min_m, config.search_lower_share * goal.height_m)
    worth = height_m <= WORTH_SHARE * goal.height_m
    if goal.kind is not GoalKind.SEARCH or passes >= config.search_passes or not worth or not state.ground_known:
        return fail(state, Reason.PAD_NOT_FOUND, now_s, config)
    lower = replace(
        numbered(state, GoalKind.SEARCH, height_m, anchor_of(state, inputs), goal.drift_ne_m_s),
        pattern_scale=goal.pattern_scale * height_m / goal.height_m,
    )
    searching = replace(state, goal=lower, since_s=now_s, search_passes=passes)
    text = OperatorText(f"{state.phase.value}: {Reason.SEARCHES_LOWER.value}, at {height_m:.1f} m")
    return Transition(searching, Reason.SEARCHES_LOWER, texts=(text,))


def turn_back(state: MissionState, inputs: MissionInputs, now_s: float, config: MissionConfig) -> Transition | None:
    """A whole search at rest, that begins with the way back to where the pad was last seen; None if it isn't time."""
    seen_s = state.left_behind_s
    if state.goal.kind is not GoalKind.SEARCH or seen_s is None or now_s - seen_s < config.search_along_s:
        return None
    return None if guidance_of(state, inputs) is None else _back(state, inputs, seen_s, now_s)


def _back(state: MissionState, inputs: MissionInputs, seen_s: float, now_s: float) -> Transition:
    north_m_s, east_m_s = state.goal.drift_ne_m_s
    anchor = anchor_of(state, inputs) - (now_s - seen_s) * np.array([north_m_s, east_m_s, 0.0])
    goal = numbered(state, GoalKind.SEARCH, state.goal.height_m, anchor)
    text = OperatorText(f"{state.phase.value}: {Reason.TURNS_BACK.value}")
    return Transition(replace(state, goal=goal, since_s=now_s, left_behind_s=None), Reason.TURNS_BACK, texts=(text,))
