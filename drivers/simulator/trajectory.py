"""Smooth setpoints for the modes that PX4 flies by itself: HOLD, TAKEOFF, LAND, RETURN, and the pilot's POSITION.

Velocity with bounded acceleration and jerk (MPC_ACC_HOR, MPC_JERK_AUTO and their vertical kin), and the position that
it integrates to; position, velocity and acceleration go to the controller together.
"""

from __future__ import annotations

import math

from app.messages import FlightMode
from drivers.simulator.controller import NAN, NO_VECTOR, Demand
from drivers.simulator.estimate import Estimate
from drivers.simulator.params import Params

ARRIVED_M = 1.0


class SmoothAxis:
    """Position, velocity and acceleration along one axis."""

    __slots__ = ("acceleration", "position", "velocity")

    def __init__(self, position: float, velocity: float) -> None:
        self.position, self.velocity, self.acceleration = position, velocity, 0.0

    def step(self, dt: float, target: float, acceleration_max: float, jerk_max: float) -> None:
        """Move the velocity towards a target."""
        # Where the velocity would end if the acceleration were taken off from now on.
        ends = self.velocity + self.acceleration * abs(self.acceleration) / (2.0 * jerk_max)
        wanted = max(-acceleration_max, min(acceleration_max, (target - ends) * 4.0))
        change = max(-jerk_max * dt, min(jerk_max * dt, wanted - self.acceleration))
        self.acceleration += change
        self.velocity += self.acceleration * dt
        self.position += self.velocity * dt


class AutoFlight:
    """Setpoints of the autonomous modes, in PX4's local frame.

    Attributes:
        reached: The take-off has reached its height.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._axes = (SmoothAxis(0, 0), SmoothAxis(0, 0), SmoothAxis(0, 0))
        self._mode = FlightMode.HOLD
        self._yaw = 0.0
        self._height_m = 0.0
        self._landing = False
        self._arrived = False
        self.reached = False

    def begin(self, mode: FlightMode, now: Estimate, height_m: float = 0.0) -> None:
        """Start a mode from where the vehicle is. height_m: over the local origin, for TAKEOFF."""
        self._axes = (SmoothAxis(now.n, now.vn), SmoothAxis(now.e, now.ve), SmoothAxis(now.d, now.vd))
        self._mode, self._yaw, self._height_m = mode, now.yaw, height_m
        self._landing = mode is FlightMode.LAND
        self._arrived = self.reached = False

    def demand(self, dt: float, now: Estimate, sticks: tuple[float, float, float]) -> Demand:
        """The setpoint now. sticks: the pilot's velocity (north, east, down, m/s), for POSITION and ALTITUDE."""
        get = self._params
        if self._mode in (FlightMode.POSITION, FlightMode.ALTITUDE):
            north, east, down = sticks
        else:
            north, east, down = self._auto_velocity(now)
        horizontal, jerk = get["MPC_ACC_HOR"], get["MPC_JERK_AUTO"]
        n, e, d = self._axes
        n.step(dt, north, horizontal, jerk)
        e.step(dt, east, horizontal, jerk)
        d.step(dt, down, get["MPC_ACC_DOWN_MAX"] if down > d.velocity else get["MPC_ACC_UP_MAX"], jerk)
        velocity = (n.velocity, e.velocity, d.velocity)
        acceleration = (n.acceleration, e.acceleration, d.acceleration)
        if self._mode is FlightMode.ALTITUDE:
            # Level attitude: nothing holds the place.
            return Demand((NAN, NAN, d.position), (NAN, NAN, d.velocity), (0.0, 0.0, d.acceleration), self._yaw)
        if self._landing:
            return Demand((n.position, e.position, NAN), velocity, (*acceleration[:2], NAN), self._yaw)
        return Demand((n.position, e.position, d.position), velocity, acceleration, self._yaw)

    def _auto_velocity(self, now: Estimate) -> tuple[float, float, float]:
        """Target velocity of the mode."""
        if self._mode is FlightMode.TAKEOFF:
            self.reached = self.reached or -now.d > self._height_m - self._params["NAV_MC_ALT_RAD"]
            return 0.0, 0.0, self._climb(self._height_m, self._params["MPC_TKO_SPEED"])
        if self._mode is FlightMode.RETURN and not self._landing:
            return self._return(now)
        if self._landing:
            return 0.0, 0.0, self._sink(now)
        return 0.0, 0.0, 0.0

    def _climb(self, height_m: float, speed: float) -> float:
        """Vertical velocity (down) towards a height over the origin."""
        error = -height_m - self._axes[2].position
        return max(-speed, min(self._params["MPC_Z_V_AUTO_DN"], 0.8 * error))

    def _sink(self, now: Estimate) -> float:
        """PX4's landing speed: slower near the height of the start."""
        get = self._params
        high, low = get["MPC_LAND_ALT1"], get["MPC_LAND_ALT2"]
        share = max(0.0, min(1.0, (-now.d - low) / (high - low)))
        return get["MPC_LAND_SPEED"] + share * (get["MPC_Z_V_AUTO_DN"] - get["MPC_LAND_SPEED"])

    def _return(self, now: Estimate) -> tuple[float, float, float]:
        """Climb to the return height, go over home, then land."""
        get = self._params
        height = max(get["RTL_RETURN_ALT"], -now.d) if not self._arrived else -now.d
        distance = math.hypot(now.n, now.e)
        if distance < ARRIVED_M and not self._arrived and -now.d < get["RTL_RETURN_ALT"]:
            height = -now.d  # over home already: straight down, as PX4 does without a climb
        climbing = -now.d < height - get["NAV_MC_ALT_RAD"]
        down = self._climb(height, get["MPC_Z_V_AUTO_UP"])
        if climbing:
            return 0.0, 0.0, down
        if distance < ARRIVED_M:
            self._arrived = self._landing = True
            return 0.0, 0.0, 0.0
        speed = min(get["MPC_XY_CRUISE"], get["MPC_XY_TRAJ_P"] * distance)
        return -now.n / distance * speed, -now.e / distance * speed, down


GROUND = Demand(NO_VECTOR, NO_VECTOR, (0.0, 0.0, 100.0))
"""Pushed onto the ground: no thrust. PX4 commands this until a take-off is wanted and after ground contact."""
