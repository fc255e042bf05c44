"""Limits on commanded velocity: speed, braking distance, acceleration and jerk. Pure."""

from __future__ import annotations

import math

import numpy as np

from app.frames import Array


def limit_norm(vector: Array, limit: float) -> Array:
    """The vector, shortened to `limit` if it is longer; its direction stays. NaN if an element is not finite."""
    norm = math.hypot(*vector.tolist())  # np.linalg.norm overflows at the root of the largest number
    if not math.isfinite(norm):
        return np.full_like(vector, math.nan)
    return vector if norm <= limit else vector * (limit / norm)


def closing_speed_m_s(distance_m: float, gain_1_s: float, speed_max_m_s: float, deceleration_m_s2: float) -> float:
    """Speed towards a point: proportional close by, along the braking parabola farther off, and never over a limit.

    The parabola v^2 = 2 a (d - d0) joins the line v = k d where both slope alike (v = a / k, d0 = a / (2 k^2)), so the
    speed can always be shed in time with the deceleration given and the command has no kink.
    """
    linear = gain_1_s * distance_m
    joint = deceleration_m_s2 / gain_1_s
    if linear > joint:
        linear = math.sqrt(2.0 * deceleration_m_s2 * (distance_m - deceleration_m_s2 / (2.0 * gain_1_s**2)))
    return min(linear, speed_max_m_s)


def approach(
    velocity: Array, acceleration: Array, wanted: Array, acceleration_max: float, jerk_max: float, dt_s: float
) -> tuple[Array, Array]:
    """The next velocity and its acceleration, on the quickest way to `wanted` that both limits leave.

    The acceleration is built up at the jerk's limit, and taken off again so early that it is gone when `wanted` is
    reached: one that stands still is not overshot. Over n turns of dt in which the acceleration falls by j dt each, a
    velocity goes by dt (n a - j dt n (n - 1) / 2), which is solved for the acceleration a that is right now, with the
    fewest turns.

    Args:
        velocity: (n,) of the last turn.
        acceleration: (n,) of the last turn: by what the velocity changed in it, over its time.
        wanted: (n,).
        acceleration_max: Limit of the acceleration's norm.
        jerk_max: Limit of the norm of the acceleration's change, a second.
        dt_s: Of this turn.

    Returns:
        Both (n,); NaN if an argument is not finite.
    """
    missing = wanted - velocity
    distance = math.hypot(*missing.tolist())
    right = np.zeros_like(missing)
    if not math.isfinite(distance):
        right = missing  # NaN stays NaN: it must not pass for a velocity that is right already
    elif distance > 0.0:
        step = jerk_max * dt_s
        turns = max(1, math.ceil((math.sqrt(1.0 + 8.0 * distance / (step * dt_s)) - 1.0) / 2.0))
        size = min(acceleration_max, distance / (turns * dt_s) + 0.5 * step * (turns - 1))
        right = missing * (size / distance)
    changed = acceleration + limit_norm(right - acceleration, jerk_max * dt_s)
    return velocity + dt_s * changed, changed
