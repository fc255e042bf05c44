"""How the simulated pad stands or drives: the motion of a car that accelerates from rest to a speed and keeps it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from app.config import PadMotionConfig

START_HEIGHT_M = 1.0
"""The vehicle has to be this high over the ground for the time before the start to count."""


@dataclass(frozen=True, slots=True)
class PadState:
    """The pad in the simulator's world: north, east, down from the vehicle's start, ground at 0 down.

    Attributes:
        north_m: Of the landmark's centre.
        east_m: Of the landmark's centre.
        down_m: Of its surface; negative: above the ground.
        vel_north_m_s: Its velocity.
        vel_east_m_s: Its velocity.
        heading_rad: Of its forward axis, clockwise from north.
        deck_half_m: Half the side of the square that can be landed on.
    """

    north_m: float
    east_m: float
    down_m: float
    vel_north_m_s: float
    vel_east_m_s: float
    heading_rad: float
    deck_half_m: float

    def offset_m(self, north_m: float, east_m: float) -> tuple[float, float]:
        """(forward, right) of a place relative to the pad's centre, in the pad's axes."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        dn, de = north_m - self.north_m, east_m - self.east_m
        return c * dn + s * de, -s * dn + c * de


class Pad:
    """The pad's motion along its heading.

    Attributes:
        state: Where it is now.
    """

    def __init__(self, config: PadMotionConfig) -> None:
        self._config = config
        self._heading = math.radians(config.heading_deg)
        self._flown_s = 0.0
        self._driven_s = 0.0
        self._waiting = config.speed_m_s > 0.0
        self.state = self._at(0.0)

    def step(self, dt: float, vehicle_height_m: float) -> PadState:
        """Advance by dt seconds. The start counts the seconds for which the vehicle was above START_HEIGHT_M."""
        if self._config.speed_m_s <= 0.0:
            return self.state
        if self._waiting:
            if vehicle_height_m > START_HEIGHT_M:
                self._flown_s += dt
                self._waiting = self._flown_s < self._config.start_after_s
            return self.state
        self._driven_s += dt
        self.state = self._at(self._driven_s)
        return self.state

    def _at(self, driven_s: float) -> PadState:
        """The state a time after it set off: constant acceleration up to the speed, then the speed."""
        config = self._config
        ramp_s = config.speed_m_s / config.acceleration_m_s2
        accelerating_s = min(driven_s, ramp_s)
        way_m = 0.5 * config.acceleration_m_s2 * accelerating_s**2 + config.speed_m_s * (driven_s - accelerating_s)
        speed = config.acceleration_m_s2 * accelerating_s
        c, s = math.cos(self._heading), math.sin(self._heading)
        return PadState(
            config.north_m + c * way_m,
            config.east_m + s * way_m,
            -config.height_m,
            c * speed,
            s * speed,
            self._heading,
            config.deck_m / 2.0,
        )
