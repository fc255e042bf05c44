"""When to sink, how fast, and when there is no way back: the descent cone and the commit. Pure.

The paper descends only inside a cone over the pad, 3 m high and 6 m across, and sinks quickly below a low height.
Here the cone narrows to the touchdown circle at the commit height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from app.config import GuidanceConfig
from app.frames import Array, clamp

ENTER_FRACTION = 0.8
"""The cone is entered at this part of its radius and left at the whole: no chatter at the rim."""
LOOK_AHEAD_S = 0.35
"""The relative velocity carries on for about so long before the controller has taken it off (PX4's lag is 0.5 s)."""
RELEASE_FACTOR = 1.5
"""A commit is taken back when the predicted error grows to this many touchdown radii, or the relative speed to this
many times what is allowed at the commit,"""
RELEASE_ABOVE_M = 0.28
"""... as long as the vehicle's centre is this high over the pad: PX4 needs 0.1 m to end a sink of 0.6 m/s, and below
that a climb would drag the feet over the deck."""
UNSEEN_S = 0.3
"""Three frames of a slow camera. A pad that has not been seen for longer says nothing about a height that has grown
since: near the deck a wrong vertical velocity of 0.4 m/s looks like a climb."""
TOUCHED_BELOW_M = 0.45
"""A contact that is felt with the vehicle's centre this low is the deck's: legs of up to 30 cm, and what PX4's height
has drifted. Higher, a gust held the vehicle up."""
SINK_LAG_S = 0.4
"""A sink that is asked for is flown so much later, all in all: PX4 has 63% of a step in 0.3 s and 90% in 0.75 s, and
the jerk limit spreads the step."""
STRICT, STRICT_FOR_S = 0.6, 3.0
"""At first a commit asks for this part of the touchdown radius, and for all of it after so long at the commit height:
between gusts there are calmer moments, and in half a second of sinking a gust moves the vehicle by some centimetres."""
SLOWING_1_S = 0.5
"""Sink speed per metre above the commit height, so that it falls from the descent speed to the touchdown speed."""


def cone_radius_m(height_m: float, config: GuidanceConfig) -> float:
    """Radius of the cone at a height above the pad."""
    if height_m >= config.cone_height_m:
        return config.cone_radius_m
    span_m = max(config.cone_height_m - config.commit_height_m, 1e-6)
    part = clamp(height_m - config.commit_height_m, 0.0, span_m) / span_m
    return config.touchdown_radius_m + part * (config.cone_radius_m - config.touchdown_radius_m)


@dataclass(frozen=True, slots=True)
class Descent:
    """The memory of one descent.

    Attributes:
        in_cone: Descent is allowed.
        committed: The landing is to be finished; high enough it is taken back if it would miss.
        waiting_since_s: Since when it is at the commit height and not committed.
        low: Committed, it was so low that nothing was to take the commit back.
        touched: The deck has been felt: the commit is not taken back any more. The shock of a touchdown puts PX4's
            velocity wrong by 0.4 m/s for seconds (measured), and with it every figure that a commit is judged by.
    """

    in_cone: bool = False
    committed: bool = False
    waiting_since_s: float | None = None
    low: bool = False
    touched: bool = False


def predicted_error_m(error_ne_m: Array, relative_ne_m_s: Array) -> float:
    """Distance from the pad's centre at touchdown: the error, and what the relative velocity adds until it is taken
    off.
    """
    return float(np.linalg.norm(error_ne_m + LOOK_AHEAD_S * relative_ne_m_s))


def touchdown_in_s(clear_m: float, sink_m_s: float, touchdown_speed_m_s: float) -> float:
    """How long until the feet are on the deck, if the vehicle sinks at the touchdown speed from now on.

    Args:
        clear_m: Between feet and deck.
        sink_m_s: Towards the deck, now: what is missing is made up late by SINK_LAG_S.
        touchdown_speed_m_s: Commanded once committed.
    """
    missing = clamp(1.0 - sink_m_s / touchdown_speed_m_s, 0.0, 1.0)
    return clamp(clear_m, 0.0, math.inf) / touchdown_speed_m_s + SINK_LAG_S * missing


def step_descent(
    memory: Descent,
    error_m: float,
    height_m: float,
    relative_speed_m_s: float,
    config: GuidanceConfig,
    now_s: float,
    predicted_m: float | None = None,
    lean_rad: float = 0.0,
    unseen_s: float = 0.0,
) -> Descent:
    """The next memory.

    Args:
        memory: The last.
        error_m: Horizontal, to the pad as it is now.
        height_m: Above it.
        relative_speed_m_s: Horizontal.
        config: [guidance].
        now_s: The clock's time.
        predicted_m: Error at touchdown; None: as now.
        lean_rad: Of the deck at touchdown.
        unseen_s: How long ago the pad was seen. What has been low is not high again because of dead reckoning.
    """
    at_touchdown_m = error_m if predicted_m is None else predicted_m
    calm = lean_rad <= math.radians(config.deck_lean_max_deg)  # so put, here and below, NaN allows nothing
    if memory.touched:
        return memory
    if memory.committed:
        off = not at_touchdown_m <= RELEASE_FACTOR * config.touchdown_radius_m
        fast = not relative_speed_m_s <= RELEASE_FACTOR * config.commit_speed_m_s
        leans = not lean_rad <= RELEASE_FACTOR * math.radians(config.deck_lean_max_deg)
        high = height_m > RELEASE_ABOVE_M and not (memory.low and unseen_s > UNSEEN_S)
        return Descent() if (off or fast or leans) and high else replace(memory, low=not high)
    radius_m = cone_radius_m(height_m, config)
    in_cone = error_m <= (radius_m if memory.in_cone else ENTER_FRACTION * radius_m)
    low = in_cone and height_m <= config.commit_height_m
    since_s = (now_s if memory.waiting_since_s is None else memory.waiting_since_s) if low else memory.waiting_since_s
    waited = 0.0 if since_s is None else clamp((now_s - since_s) / STRICT_FOR_S, 0.0, 1.0)
    allowed_m = (STRICT + (1.0 - STRICT) * waited) * config.touchdown_radius_m
    ready = (
        low
        and error_m <= allowed_m
        and at_touchdown_m <= allowed_m
        and relative_speed_m_s <= config.commit_speed_m_s
        and calm
    )
    return Descent(in_cone=in_cone, committed=ready, waiting_since_s=since_s)


def feel_deck(memory: Descent, height_m: float, *, contact: bool) -> Descent:
    """The next memory, from what the contact monitor says at this height above the pad."""
    return replace(memory, touched=memory.touched or (memory.committed and contact and height_m <= TOUCHED_BELOW_M))


def sink_speed_m_s(memory: Descent, height_m: float, config: GuidanceConfig) -> float:
    """Speed towards the pad, positive down: 0 outside the cone; inside it falls towards the commit height, where an
    uncommitted vehicle stops; committed, it is the touchdown speed, all the way down.
    """
    if memory.committed:
        return config.touchdown_speed_m_s
    above_m = height_m - config.commit_height_m
    if not memory.in_cone or math.isnan(above_m):
        return 0.0
    if above_m <= 0.0:
        return -min(0.3, -above_m)  # climb back to the commit height and try to settle there
    return min(config.descend_speed_m_s, 0.25 + SLOWING_1_S * above_m)
