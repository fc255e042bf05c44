"""Limits on commanded velocity: speed, braking distance and acceleration. Pure."""

from __future__ import annotations

import math

import numpy as np

from app.frames import Array


def limit_norm(vector: Array, limit: float) -> Array:
    """The vector, shortened to `limit` if it is longer; its direction stays."""
    norm = float(np.linalg.norm(vector))
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


def slew(previous: Array, wanted: Array, rate_max: float, dt_s: float) -> Array:
    """`wanted`, but no farther from `previous` than `rate_max * dt_s`."""
    return previous + limit_norm(wanted - previous, rate_max * dt_s)
