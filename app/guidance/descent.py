"""When to sink, how fast, and when there is no way back: the descent cone and the commit. Pure.

The paper descends only inside a cone over the pad, 3 m high and 6 m across, and sinks quickly below a low height.
Here the cone narrows to the touchdown circle at the commit height.
"""

from __future__ import annotations

from dataclasses import dataclass

from app.config import GuidanceConfig

ENTER_FRACTION = 0.8
"""The cone is entered at this part of its radius and left at the whole: no chatter at the rim."""
SLOWING_1_S = 0.5
"""Sink speed per metre above the commit height, so that it falls from the descent speed to the touchdown speed."""


def cone_radius_m(height_m: float, config: GuidanceConfig) -> float:
    """Radius of the cone at a height above the pad."""
    if height_m >= config.cone_height_m:
        return config.cone_radius_m
    span_m = max(config.cone_height_m - config.commit_height_m, 1e-6)
    part = max(0.0, height_m - config.commit_height_m) / span_m
    return config.touchdown_radius_m + part * (config.cone_radius_m - config.touchdown_radius_m)


@dataclass(frozen=True, slots=True)
class Descent:
    """The memory of one descent.

    Attributes:
        in_cone: Descent is allowed.
        committed: Nothing but an abort ends the landing now.
    """

    in_cone: bool = False
    committed: bool = False


def step_descent(
    memory: Descent, error_m: float, height_m: float, relative_speed_m_s: float, config: GuidanceConfig
) -> Descent:
    """The next memory, from the horizontal error to the predicted pad, the height above it and the relative speed."""
    if memory.committed:
        return memory
    radius_m = cone_radius_m(height_m, config)
    in_cone = error_m <= (radius_m if memory.in_cone else ENTER_FRACTION * radius_m)
    ready = (
        height_m <= config.commit_height_m
        and error_m <= config.touchdown_radius_m
        and relative_speed_m_s <= config.commit_speed_m_s
    )
    return Descent(in_cone=in_cone, committed=in_cone and ready)


def sink_speed_m_s(memory: Descent, height_m: float, config: GuidanceConfig) -> float:
    """Speed towards the pad, positive down: 0 outside the cone; inside it falls towards the commit height, where an
    uncommitted vehicle stops; committed, it is the touchdown speed, all the way down.
    """
    if memory.committed:
        return config.touchdown_speed_m_s
    above_m = height_m - config.commit_height_m
    if not memory.in_cone:
        return 0.0
    if above_m <= 0.0:
        return -min(0.3, -above_m)  # climb back to the commit height and try to settle there
    return min(config.descend_speed_m_s, 0.25 + SLOWING_1_S * above_m)
