"""The simulated world: vehicle, flight controller, wind and pad, stepped together; and what is true of it.

A pure stepper: no sockets, no threads, no clock. The same configuration and seed give the same flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from app.config import WorldConfig
from drivers.simulator.pad import Pad, PadState
from drivers.simulator.plant import Plant
from drivers.simulator.px4 import Px4
from drivers.simulator.touchdown import Contact, Seen, TouchdownWatch
from drivers.simulator.wind import Wind

STEP_S = 0.004
"""250 steps a second, as PX4's inner loops."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Vehicle and pad at one instant: what the renderer draws and the log keeps.

    Attributes:
        t_s: Seconds since the world began.
        pos: Body origin: north, east, down of the vehicle's start on the ground, m.
        vel: m/s.
        q: ned_from_body, w x y z.
        rates: About the body's axes, rad/s.
        pad: The pad.
    """

    t_s: float
    pos: tuple[float, float, float]
    vel: tuple[float, float, float]
    q: tuple[float, float, float, float]
    rates: tuple[float, float, float]
    pad: PadState


class World:
    """Everything that moves.

    Args:
        config: The world's figures; its seed makes the flight.
        estimate_error_scale: Multiplies the errors of the flight controller's estimate; 0 lets it know the truth.

    Attributes:
        t_s: Seconds since it began.
        plant: The vehicle.
        px4: Its flight controller.
        pad: The pad.
        contacts: Touchdowns, rests and crashes so far.
    """

    def __init__(self, config: WorldConfig, estimate_error_scale: float = 1.0) -> None:
        self.t_s = 0.0
        self.plant = Plant(heading_rad=math.radians(config.start_heading_deg))
        errors = estimate_error_scale * config.estimate_error
        self.px4 = Px4(self.plant, config.seed * 7919 + 1, errors, gnss=config.gnss, parameters=config.parameters)
        self.pad = Pad(config.motion, config.seed)
        self.contacts: list[Contact] = []
        self._wind = Wind(config.wind_m_s, config.wind_from_deg, config.gust_m_s, config.seed * 7919 + 2)
        self._watch = TouchdownWatch()
        self._steps = 0

    def step(self) -> None:
        """Advance by STEP_S."""
        self._steps += 1
        self.t_s = self._steps * STEP_S
        self.px4.step(STEP_S)
        body = self.plant.body
        pad = self.pad.step(STEP_S, self.plant.height_m, (body.n, body.e))
        self.plant.step(STEP_S, self._wind.step(STEP_S), pad)
        self.contacts += self._watch.step(self._seen(pad), pad)
        if self.plant.crashed is not None and self.px4.commander.armed:
            self.px4.disarm(force=True)

    def truth(self) -> Truth:
        """The present instant."""
        b = self.plant.body
        return Truth(
            self.t_s, (b.n, b.e, b.d), (b.vn, b.ve, b.vd), (b.qw, b.qx, b.qy, b.qz), (b.p, b.q, b.r), self.pad.state
        )

    def _seen(self, pad: PadState) -> Seen:
        b, feet = self.plant.body, self.plant.feet
        cos_tilt = 1.0 - 2.0 * (b.qx * b.qx + b.qy * b.qy)
        return Seen(
            self.t_s,
            (b.n, b.e, b.d),
            (b.vn, b.ve, b.vd),
            math.acos(max(-1.0, min(1.0, cos_tilt))),
            feet.touching > 0,
            feet.on_deck > 0,
            self.px4.commander.armed,
            self.plant.crashed,
            feet.clearance_m(b, pad),
        )
