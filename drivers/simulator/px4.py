"""The simulated flight controller: what PX4 does between a setpoint or a command and the motors.

Composed of estimate, commander (arming, modes, failsafes), trajectory (autonomous modes), controller and land
detector; it knows no link: endpoint.py speaks MAVLink for it, and drivers.autopilot.simulated calls it directly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from app.errors import ConfigError
from app.messages import FlightMode, LandedState
from drivers.simulator.commander import Commander, Result
from drivers.simulator.controller import Demand, Limits, PositionController, attitude_rates
from drivers.simulator.estimate import Estimate, Estimator
from drivers.simulator.land_detector import LandDetector, LandInputs
from drivers.simulator.params import DEFAULTS, Params
from drivers.simulator.plant import GRAVITY_M_S2, Plant
from drivers.simulator.trajectory import GROUND, AutoFlight

OUTER_EVERY = 2
"""The position loop runs on every second step: 125 Hz at 250."""
TILT_SLEW_RAD_S = math.radians(30.0)
SPOOL_UP_S = 1.0
"""PX4's COM_SPOOLUP_TIME."""


class Px4:
    """The autopilot of one vehicle.

    Args:
        plant: The vehicle.
        seed: Of the estimate's errors.
        estimate_error_scale: Multiplies them.
        gnss: False: its position is the integral of its velocity, and drifts.
        parameters: PX4's, where not its defaults.

    Raises:
        ConfigError: There is no such parameter.

    Attributes:
        params: PX4's parameters.
        commander: Arming and modes.
        detector: The land detector.
        sticks: The pilot's wish in POSITION and ALTITUDE: velocity north, east, down, m/s.
        uptime_s: Since it started.
    """

    def __init__(
        self,
        plant: Plant,
        seed: int,
        estimate_error_scale: float = 1.0,
        *,
        gnss: bool = True,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.params = Params()
        for name, value in (parameters or {}).items():
            if name not in DEFAULTS:
                raise ConfigError(
                    f"parameters.{name} = {value:g}: the simulated PX4 has no such parameter",
                    f"it has {', '.join(DEFAULTS)}",
                )
            self.params.set(name, value)
        # PX4 estimates its hover thrust in flight (MPC_USE_HTE); here it is known from the start.
        self.params.set("MPC_THR_HOVER", plant.airframe.hover_thrust)
        self.commander = Commander(self.params)
        self.detector = LandDetector(self.params)
        self.sticks = (0.0, 0.0, 0.0)
        self.uptime_s = 0.0
        self._plant = plant
        self._estimator = Estimator(plant.body, seed, estimate_error_scale, gnss=gnss)
        self._controller = PositionController(self.params)
        self._auto = AutoFlight(self.params)
        self._demand = Demand()
        self._offboard: Demand | None = None
        self._auto_mode: FlightMode | None = None
        self._takeoff_height_m = 0.0
        self._flight = 0.0
        self._ready_at_s: float | None = None
        self._tilt_limit = math.radians(12.0)
        self._count = 0
        self._estimator.step(1e-3, plant.body)

    # ------------------------------------------------------------------------------------------------ what users see
    @property
    def estimate(self) -> Estimate:
        """What it believes of itself."""
        return self._estimator.estimate

    @property
    def landed_state(self) -> LandedState:
        """As EXTENDED_SYS_STATE reports it."""
        if self.detector.landed:
            return LandedState.ON_GROUND
        if self.commander.mode is FlightMode.TAKEOFF:
            return LandedState.TAKING_OFF
        return LandedState.LANDING if self.commander.mode is FlightMode.LAND else LandedState.IN_AIR

    @property
    def collective(self) -> float:
        """Demanded thrust, fraction of the whole."""
        return self._controller.collective if self.commander.armed else 0.0

    @property
    def demand(self) -> Demand:
        """The setpoint that it flies."""
        return self._demand

    # ------------------------------------------------------------------------------------------- what users can do
    def offboard_setpoint(self, demand: Demand) -> None:
        """SET_POSITION_TARGET_LOCAL_NED: one that leaves an axis uncontrolled is ignored, as PX4 does."""
        if demand.complete:
            self._offboard = demand
            self.commander.setpoint_arrived()

    def arm(self, force: bool = False) -> Result:
        """Arm."""
        return self.commander.arm(force)

    def disarm(self, force: bool = False) -> Result:
        """Disarm; refused in the air unless forced."""
        return self.commander.disarm(self.detector.landed or self.detector.maybe_landed, force)

    def takeoff(self, height_m: float | None = None) -> Result:
        """Climb to a height over the local origin; None: MIS_TAKEOFF_ALT over the present place."""
        here = -self.estimate.d
        self._takeoff_height_m = here + self.params["MIS_TAKEOFF_ALT"] if height_m is None else height_m
        self._auto_mode = None
        return self.commander.set_mode(FlightMode.TAKEOFF)

    def set_mode(self, mode: FlightMode) -> Result:
        """Change the mode: the companion's, the ground station's or the pilot's doing."""
        if mode is FlightMode.TAKEOFF:
            return self.takeoff()
        return self.commander.set_mode(mode)

    # ------------------------------------------------------------------------------------------------------ stepping
    def step(self, dt: float) -> None:
        """Advance by dt seconds: read the sensors, run the loops, command the motors."""
        self.uptime_s += dt
        now = self._estimator.step(dt, self._plant.body)
        self._count += 1
        if self._count % OUTER_EVERY == 0:
            self._outer(dt * OUTER_EVERY, now)
        if self.commander.armed:
            controller = self._controller
            rates = attitude_rates(controller.thrust, controller.yaw, controller.yaw_rate, now, self.params)
            self._plant.command(True, rates, controller.collective)
        else:
            self._plant.command(False, (0.0, 0.0, 0.0), 0.0)

    def _outer(self, dt: float, now: Estimate) -> None:
        """Commander, setpoint, position loop, land detector."""
        commander = self.commander
        commander.step(self.uptime_s, self.detector.landed)
        self._demand = self._setpoint(dt, now)
        self._follow(dt, now)
        force = self._plant.specific_force
        self.detector.step(
            self.uptime_s,
            LandInputs(
                armed=commander.armed,
                thrust=self.collective,
                climb_rate_controlled=commander.mode is not FlightMode.MANUAL,
                velocity_demand_down=self._demand.velocity[2],
                vertical_speed=now.vd,
                height_rate=now.d_rate,
                horizontal_speed=math.hypot(now.vn, now.ve),
                tilt_rate=math.hypot(now.rates[0], now.rates[1]),
                specific_force=math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2),
            ),
        )

    def _setpoint(self, dt: float, now: Estimate) -> Demand:
        """The demand of the present mode."""
        mode = self.commander.mode
        if mode is FlightMode.OFFBOARD and self._offboard is not None:
            self._auto_mode = None
            return self._offboard
        if mode is not self._auto_mode:
            self._auto.begin(mode, now, self._takeoff_height_m)
            self._auto_mode = mode
        if not self.commander.armed or self._flight < 1.0:
            # On the ground the smooth setpoint would run away from the vehicle.
            self._auto.begin(mode, now, self._takeoff_height_m)
        demand = self._auto.demand(dt, now, self.sticks)
        if mode is FlightMode.TAKEOFF and self._auto.reached:
            # HOLD goes on climbing to the height that the take-off was for: the smooth setpoint runs on.
            self.commander.set_mode(FlightMode.HOLD)
            self._auto_mode = FlightMode.HOLD
        return demand

    def _takeoff_wanted(self) -> bool:
        mode, demand = self.commander.mode, self._demand
        if mode is FlightMode.OFFBOARD:
            return demand.position[2] < self.estimate.d or demand.velocity[2] < 0.0 or demand.acceleration[2] < 0.0
        if mode in (FlightMode.POSITION, FlightMode.ALTITUDE):
            return self.sticks[2] < 0.0
        return mode is FlightMode.TAKEOFF

    def _follow(self, dt: float, now: Estimate) -> None:
        """Take-off state and position loop. `_flight`: 0 on the ground, rising to 1 in the take-off ramp, 1 flying."""
        get = self.params
        up, down = get["MPC_Z_VEL_MAX_UP"], get["MPC_Z_VEL_MAX_DN"]
        if not self.commander.armed:
            self._flight, self._ready_at_s = 0.0, None
        elif self._ready_at_s is None:
            self._ready_at_s = self.uptime_s + SPOOL_UP_S
        ready = self._ready_at_s is not None and self.uptime_s >= self._ready_at_s
        if self._flight >= 1.0 and self.detector.landed:
            self._flight = 0.0
        if ready and self._flight < 1.0 and (self._flight > 0.0 or self._takeoff_wanted()):
            self._flight += dt / max(dt, get["MPC_TKO_RAMP_T"])
        demand = self._demand
        flying = self._flight >= 1.0
        if self._flight <= 0.0 or (flying and self.detector.ground_contact):
            demand = GROUND
            self._controller.reset()
        elif not flying:
            # PX4's ramp: the upward limit goes from a push onto the ground of one g to the whole climb speed.
            lowest = -GRAVITY_M_S2 / get["MPC_Z_VEL_P_ACC"]
            speed = get["MPC_TKO_SPEED"] if self.commander.mode is FlightMode.TAKEOFF else up
            up = lowest + self._flight * (speed - lowest)
            demand = Demand(demand.position, demand.velocity, (*demand.acceleration[:2], math.nan), demand.yaw)
        wanted = math.radians(get["MPC_TILTMAX_AIR"] if flying else get["MPC_TILTMAX_LND"])
        slew = TILT_SLEW_RAD_S * dt
        self._tilt_limit += max(-slew, min(slew, wanted - self._tilt_limit))
        limits = Limits(up, down, self._tilt_limit, get["MPC_THR_MIN"] if flying else 0.0)
        self._controller.update(dt, demand, now, limits)
