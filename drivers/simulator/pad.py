"""How the simulated pad moves: a car that drives off, bends and brakes; a deck that rolls, pitches and heaves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from app.config import PadMotionConfig
from drivers.simulator.waves import Waves

START_HEIGHT_M = 1.0
"""The vehicle has to be this high over the ground for the time before the start to count."""
STEER_S = 1.0
"""From straight on to the whole curvature of a bend: a driver turns the wheel."""


@dataclass(frozen=True)
class PadState:
    """The pad in the simulator's world: north, east, down from the vehicle's start, ground at 0 down.

    Attributes:
        north_m: Of the landmark's centre.
        east_m: Of the landmark's centre.
        down_m: Of its surface there; negative: above the ground.
        vel_north_m_s: Its velocity.
        vel_east_m_s: Its velocity.
        heading_rad: Of its forward axis, clockwise from north.
        deck_half_m: Half the side of the square that can be landed on.
        vel_down_m_s: Its velocity.
        roll_rad: Its right side down.
        pitch_rad: Its front up.
        heading_rate_rad_s: Of its heading.
        roll_rate_rad_s: Of its roll.
        pitch_rate_rad_s: Of its pitch.
    """

    north_m: float
    east_m: float
    down_m: float
    vel_north_m_s: float
    vel_east_m_s: float
    heading_rad: float
    deck_half_m: float
    vel_down_m_s: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    heading_rate_rad_s: float = 0.0
    roll_rate_rad_s: float = 0.0
    pitch_rate_rad_s: float = 0.0

    @cached_property
    def axes(self) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
        """Forward, right and down axis, each north, east, down: yaw, then pitch, then roll."""
        ch, sh = math.cos(self.heading_rad), math.sin(self.heading_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        return (
            (cp * ch, cp * sh, -sp),
            (sr * sp * ch - cr * sh, sr * sp * sh + cr * ch, sr * cp),
            (cr * sp * ch + sr * sh, cr * sp * sh - sr * ch, cr * cp),
        )

    @cached_property
    def turn_rate(self) -> tuple[float, float, float]:
        """Angular velocity, north, east, down, rad/s: heading about down, pitch about the level right, roll about
        forward.
        """
        ch, sh = math.cos(self.heading_rad), math.sin(self.heading_rad)
        forward = self.axes[0]
        p, q = self.roll_rate_rad_s, self.pitch_rate_rad_s
        return (
            p * forward[0] - q * sh,
            p * forward[1] + q * ch,
            p * forward[2] + self.heading_rate_rad_s,
        )

    @property
    def tilt_rad(self) -> float:
        """Angle of the deck from level."""
        return math.acos(max(-1.0, min(1.0, self.axes[2][2])))

    @property
    def is_level(self) -> bool:
        """Neither rolls nor pitches."""
        return self.roll_rad == 0.0 and self.pitch_rad == 0.0

    def offset_m(self, north_m: float, east_m: float) -> tuple[float, float]:
        """(forward, right) of a place relative to the pad's centre, along the pad's heading and level."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        dn, de = north_m - self.north_m, east_m - self.east_m
        return c * dn + s * de, -s * dn + c * de

    def on_deck_m(self, north_m: float, east_m: float, down_m: float) -> tuple[float, float, float]:
        """(forward, right, down) of a point relative to the pad's centre, in the deck's own axes."""
        dn, de, dd = north_m - self.north_m, east_m - self.east_m, down_m - self.down_m
        f, r, d = self.axes
        return (
            f[0] * dn + f[1] * de + f[2] * dd,
            r[0] * dn + r[1] * de + r[2] * dd,
            d[0] * dn + d[1] * de + d[2] * dd,
        )

    def surface_down_m(self, north_m: float, east_m: float) -> float:
        """Down of the deck's plane over or under a place."""
        if self.is_level:
            return self.down_m
        n, e, d = self.axes[2]
        return self.down_m - (n * (north_m - self.north_m) + e * (east_m - self.east_m)) / d

    def velocity_at(self, north_m: float, east_m: float, down_m: float) -> tuple[float, float, float]:
        """Velocity (north, east, down) of the deck's own point that is there now."""
        rn, re, rd = north_m - self.north_m, east_m - self.east_m, down_m - self.down_m
        wn, we, wd = self.turn_rate
        return (
            self.vel_north_m_s + we * rd - wd * re,
            self.vel_east_m_s + wd * rn - wn * rd,
            self.vel_down_m_s + wn * re - we * rn,
        )


class Pad:
    """The pad's motion.

    Args:
        config: Its figures.
        seed: Of the waves.

    Attributes:
        state: Where it is now.
        at_speed_s: For how long it has driven at its whole speed; 0 before. A pad that never drives is always there.
    """

    def __init__(self, config: PadMotionConfig, seed: int = 0) -> None:
        self._config = config
        self._waves = Waves(config, seed) if max(config.roll_deg, config.pitch_deg, config.heave_m) > 0.0 else None
        self._t_s = 0.0
        self._flown_s = 0.0
        self._driven_s = 0.0
        self._waiting = config.speed_m_s > 0.0
        self._north, self._east, self._heading = config.north_m, config.east_m, math.radians(config.heading_deg)
        self._speed = self._curvature = 0.0
        self.at_speed_s = 0.0
        self.state = self._now()

    def step(self, dt: float, vehicle_height_m: float, vehicle_at_m: tuple[float, float] | None = None) -> PadState:
        """Advance by dt seconds.

        Args:
            dt: Seconds.
            vehicle_height_m: Over the ground: above START_HEIGHT_M it flies, and the time until the start counts.
            vehicle_at_m: North and east of the vehicle; where none is told it counts as near.
        """
        if self._waiting and vehicle_height_m > START_HEIGHT_M:
            near_m = self._config.start_near_m
            if near_m is None or vehicle_at_m is None or math.hypot(*self.state.offset_m(*vehicle_at_m)) < near_m:
                self._flown_s += dt
            self._waiting = self._flown_s < self._config.start_after_s
        elif self._config.speed_m_s > 0.0 and not self._waiting:
            self._drive(dt)
        elif self._config.speed_m_s == 0.0:
            self.at_speed_s += dt
            if self._waves is None:
                return self.state
        self._t_s += dt
        self.state = self._now()
        return self.state

    def _drive(self, dt: float) -> None:
        """Along the heading: up to the speed, at it, and down to a stop; straight, then round the bend."""
        config, before = self._config, self._speed
        self._driven_s += dt
        if config.brake_after_s is not None and self.at_speed_s >= config.brake_after_s:
            self._speed = max(0.0, before - config.brake_m_s2 * dt)
        else:
            self._speed = min(config.speed_m_s, before + config.acceleration_m_s2 * dt)
        if self.at_speed_s > 0.0 or self._speed >= config.speed_m_s:
            self.at_speed_s += dt
        turned = 0.0
        if config.bend_radius_m != 0.0:
            share = min(1.0, max(0.0, (self._driven_s - config.bend_after_s) / STEER_S))
            self._curvature = share / config.bend_radius_m
            turned = 0.5 * (before + self._speed) * self._curvature * dt
        way, middle = 0.5 * (before + self._speed) * dt, self._heading + 0.5 * turned
        self._north += way * math.cos(middle)
        self._east += way * math.sin(middle)
        self._heading += turned

    def _now(self) -> PadState:
        c, s = math.cos(self._heading), math.sin(self._heading)
        speed, config = self._speed, self._config
        level = PadState(
            self._north,
            self._east,
            -config.height_m,
            c * speed,
            s * speed,
            self._heading,
            config.deck_m / 2.0,
            heading_rate_rad_s=speed * self._curvature,
        )
        return level if self._waves is None else self._waves.carry(level, self._t_s)
