"""A world that a test steps by hand, with a companion that streams setpoints at 50 Hz."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from app.config import PadMotionConfig, WorldConfig
from app.messages import FlightMode
from drivers.simulator.commander import Result
from drivers.simulator.controller import Demand
from drivers.simulator.world import STEP_S, World

FAR = PadMotionConfig(north_m=500.0, east_m=500.0)
SETPOINT_PERIOD_S = 0.02


class Flight:
    """One flight in a calm unless asked otherwise."""

    def __init__(
        self,
        *,
        errors: float = 0.0,
        motion: PadMotionConfig = FAR,
        wind_m_s: float = 0.0,
        gust_m_s: float = 0.0,
        seed: int = 1,
    ) -> None:
        config = WorldConfig(seed=seed, motion=motion, wind_m_s=wind_m_s, gust_m_s=gust_m_s)
        self.world = World(config, errors)
        self.px4 = self.world.px4
        self.body = self.world.plant.body
        self.setpoint: Demand | None = None
        self._due_s = 0.0

    def run(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        for _ in range(round(seconds / STEP_S)):
            if self.setpoint is not None and self.world.t_s >= self._due_s:
                self._due_s = self.world.t_s + SETPOINT_PERIOD_S - 1e-9
                self.px4.offboard_setpoint(self.setpoint)
            self.world.step()
            if each is not None:
                each()

    def until(self, condition: Callable[[], bool], limit_s: float) -> float:
        """Seconds until a condition holds; infinite if it doesn't within the limit."""
        start_s = self.world.t_s
        while self.world.t_s - start_s < limit_s:
            if condition():
                return self.world.t_s - start_s
            self.run(STEP_S)
        return math.inf

    def velocity(self, north: float, east: float, down: float, yaw: float = 0.0) -> None:
        self.setpoint = Demand(velocity=(north, east, down), yaw=yaw)

    def take_off(self, height_m: float) -> None:
        """Armed, in OFFBOARD, at rest at a height."""
        self.run(3.1)
        assert self.px4.arm() is Result.ACCEPTED
        assert self.px4.takeoff(height_m) is Result.ACCEPTED
        self.until(lambda: self.px4.commander.mode is FlightMode.HOLD, 60.0)
        self.run(5.0)
        self.velocity(0.0, 0.0, 0.0)
        self.run(1.0)
        assert self.px4.set_mode(FlightMode.OFFBOARD) is Result.ACCEPTED
        self.run(3.0)


@pytest.fixture
def flight() -> Callable[..., Flight]:
    return Flight
