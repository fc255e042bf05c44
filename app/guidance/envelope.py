"""The envelope: bounds that every setpoint keeps, whatever made it. Pure.

The one last place before the link. A controller may err, a track may copy the vehicle's own motion, a height may jump:
what leaves the machine still keeps to the speeds of [guidance], to what pads do, and to a floor and a ceiling.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from app.config import RigConfig
from app.frames import clamp, wrap_angle_rad
from app.guidance.limits import limit_norm
from app.messages import Setpoint

HEAVE_MAX_M_S = 2.0
"""A deck rises and falls no faster. A wave of height H and period T moves what floats on it at pi H / T. In sea state 4
waves are 1.25 to 2.5 m high (significant height) with periods of 6 to 8 s; the highest of a thousand is 1.86 times as
high (Rayleigh distribution: sqrt(ln(1000) / 2)), so a small boat reaches pi 4.65 / 8 = 1.8 m/s at most."""
NEAR_GROUND_M = 3.0
SINK_NEAR_GROUND_M_S = 1.8
"""Lower than NEAR_GROUND_M over pad or home: the touchdown speed, and half the fastest deck. TOO_FAST begins at 2."""
HEIGHT_GAIN_1_S = 0.8
"""Floor and ceiling are approached at this part of the distance a second, as guidance approaches a height."""


@dataclass(frozen=True, slots=True)
class Envelope:
    """The bounds.

    Attributes:
        speed_max_m_s: Horizontal.
        climb_max_m_s: Upward.
        sink_max_m_s: Downward.
        acceleration_max_m_s2: Of the feed-forward: horizontal, and vertical.
        floor_m: Height over home below which nothing sinks that has no usable track.
        ceiling_m: Height over home above which nothing climbs.
    """

    speed_max_m_s: float
    climb_max_m_s: float
    sink_max_m_s: float
    acceleration_max_m_s2: float
    floor_m: float
    ceiling_m: float


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Where the vehicle is when a setpoint is made.

    Attributes:
        over_home_m: Height over home; None: home is not known.
        over_pad_m: Height over the pad by a track that is usable; None without one.
        rests: It rests on the pad: more sink than it flies is asked for, so that PX4 takes its thrust off.
    """

    over_home_m: float | None = None
    over_pad_m: float | None = None
    rests: bool = False


def envelope_of(config: RigConfig) -> Envelope:
    """The envelope of a rig: its speeds, and what a deck adds to the vertical ones."""
    guidance = config.guidance
    fastest = max(guidance.descend_speed_m_s, guidance.touchdown_speed_m_s, guidance.press_speed_m_s)
    return Envelope(
        speed_max_m_s=guidance.speed_max_m_s,
        climb_max_m_s=guidance.climb_speed_m_s + HEAVE_MAX_M_S,
        sink_max_m_s=fastest + HEAVE_MAX_M_S,
        acceleration_max_m_s2=guidance.acceleration_max_m_s2 + guidance.gust_max_m_s2,
        floor_m=config.mission.search_height_min_m,
        ceiling_m=config.safety.height_max_m,
    )


def bounded(setpoint: Setpoint, envelope: Envelope, place: Surroundings) -> Setpoint | None:
    """The setpoint within the envelope; None if one of its figures is not finite."""
    figures = [setpoint.t_s, *setpoint.vel_ned_m_s, *setpoint.acc_ned_m_s2, setpoint.yaw_ned_rad]
    if not np.isfinite(figures).all():
        return None
    velocity, acceleration = np.empty(3), np.empty(3)
    velocity[:2] = limit_norm(setpoint.vel_ned_m_s[:2], envelope.speed_max_m_s)
    velocity[2] = clamp(
        float(setpoint.vel_ned_m_s[2]), -_climb_max_m_s(envelope, place), _sink_max_m_s(envelope, place)
    )
    most = envelope.acceleration_max_m_s2
    acceleration[:2] = limit_norm(setpoint.acc_ned_m_s2[:2], most)
    acceleration[2] = clamp(float(setpoint.acc_ned_m_s2[2]), -most, most)
    if not np.isfinite([*velocity, *acceleration]).all():  # the norm of what is finite may not be
        return None
    return replace(
        setpoint,
        vel_ned_m_s=velocity,
        acc_ned_m_s2=acceleration,
        yaw_ned_rad=wrap_angle_rad(setpoint.yaw_ned_rad),
    )


def _climb_max_m_s(envelope: Envelope, place: Surroundings) -> float:
    if place.over_home_m is None:
        return envelope.climb_max_m_s
    return _share(envelope.ceiling_m - place.over_home_m, envelope.climb_max_m_s)


def _sink_max_m_s(envelope: Envelope, place: Surroundings) -> float:
    if place.over_pad_m is None:
        return _share((place.over_home_m or 0.0) - envelope.floor_m, envelope.sink_max_m_s)
    lowest_m = place.over_pad_m if place.over_home_m is None else min(place.over_pad_m, place.over_home_m)
    if place.rests or lowest_m > NEAR_GROUND_M:
        return envelope.sink_max_m_s
    return min(envelope.sink_max_m_s, SINK_NEAR_GROUND_M_S)


def _share(distance_m: float, most_m_s: float) -> float:
    """Speed towards a bound that far away; none beyond it, and none where the distance is not a number."""
    return 0.0 if math.isnan(distance_m) else clamp(HEIGHT_GAIN_1_S * distance_m, 0.0, most_m_s)
