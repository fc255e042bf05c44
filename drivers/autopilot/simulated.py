"""PX4 in process: the Autopilot port on the simulated flight controller, for flights under a virtual clock.

There is no MAVLink in it; the real link's driver flies the same flight controller through the simulator's process.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Self

import numpy as np

from app.channels import Latest
from app.errors import AutopilotError
from app.messages import AutopilotAction, FlightMode, LandingTarget, ParameterFinding, Setpoint, VehicleState
from app.ports import always
from drivers.simulator.commander import Result
from drivers.simulator.controller import NO_VECTOR, Demand
from drivers.simulator.telemetry import BATTERY_DRAIN_1_S
from drivers.simulator.virtual import SimulatedWorld

CONNECT_TIMEOUT_S = 5.0
SILENCE_S = 0.5
"""With no telemetry for this long the last state is told again, as not connected."""
ANSWER_S = 0.008
"""From a command to its answer, as the link measures."""


class SimulatedAutopilot:
    """app.ports.Autopilot on a SimulatedWorld.

    Args:
        world: Whose vehicle it is; its run() has to run.

    Attributes:
        setpoints: How many were sent.
    """

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world
        self._turned: Latest[float] = world.turned.subscribe()
        self._flown_s = 0.0
        self._last_s: float | None = None
        self.setpoints = 0

    async def __aenter__(self) -> Self:
        """Wait for the first state."""
        first: Latest[float] = self._world.turned.subscribe()
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                await first.get()
        except TimeoutError:
            raise AutopilotError("the simulated world stands still", "run SimulatedWorld.run() as a task") from None
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing to release."""

    @property
    def parameter_findings(self) -> tuple[ParameterFinding, ...]:
        """None: the world sets its parameters itself."""
        return ()

    async def states(self) -> AsyncIterator[VehicleState]:
        """The newest state at each turn of the world."""
        now_s = 0.0
        while True:
            connected = True
            try:
                async with asyncio.timeout(SILENCE_S):
                    now_s = await self._turned.get()
            except TimeoutError:
                connected = False
            yield self._state(now_s, connected)

    async def send_setpoint(self, setpoint: Setpoint) -> None:
        """Give the flight controller one setpoint: velocity, acceleration and heading (type mask 2055)."""
        velocity, acceleration = setpoint.vel_ned_m_s, setpoint.acc_ned_m_s2
        self.setpoints += 1
        self._world.px4.offboard_setpoint(
            Demand(
                NO_VECTOR,
                (float(velocity[0]), float(velocity[1]), float(velocity[2])),
                (float(acceleration[0]), float(acceleration[1]), float(acceleration[2])),
                setpoint.yaw_ned_rad,
            )
        )

    async def send_landing_target(self, target: LandingTarget) -> None:
        """The simulated PX4 has no precision landing, and refuses its mode."""

    async def execute(
        self,
        action: AutopilotAction,
        *,
        height_m: float = 0.0,
        asked_s: float | None = None,
        wanted: Callable[[], bool] = always,
    ) -> None:
        """Run an action to its answer.

        Raises:
            AutopilotError: It was refused.
        """
        px4 = self._world.px4
        told = px4.commander.texts[-1].number if px4.commander.texts else 0
        await asyncio.sleep(ANSWER_S)
        result = self._run(action, height_m)
        if result is not Result.ACCEPTED:
            words = "; ".join(text.text for text in px4.commander.texts if text.number > told)
            raise AutopilotError(f"PX4 refused to {action.value}: {words or result.name.lower()}", "mend that")

    def _run(self, action: AutopilotAction, height_m: float) -> Result:
        px4 = self._world.px4
        match action:
            case AutopilotAction.ARM:
                return px4.arm()
            case AutopilotAction.TAKEOFF:
                return px4.takeoff(-px4.estimate.d + height_m)
            case AutopilotAction.OFFBOARD:
                return px4.set_mode(FlightMode.OFFBOARD)
            case AutopilotAction.HOLD:
                return px4.set_mode(FlightMode.HOLD)
            case AutopilotAction.LAND:
                return px4.set_mode(FlightMode.LAND)
            case AutopilotAction.PRECLAND:
                return Result.DENIED
            case AutopilotAction.RETURN:
                return px4.set_mode(FlightMode.RETURN)
            case AutopilotAction.DISARM:
                return px4.disarm()
            case AutopilotAction.FORCE_DISARM:
                return px4.disarm(force=True)

    def _state(self, now_s: float, connected: bool) -> VehicleState:
        px4 = self._world.px4
        now = px4.estimate
        if px4.commander.armed and self._last_s is not None:
            self._flown_s += now_s - self._last_s
        self._last_s = now_s
        return VehicleState(
            now_s,
            np.array([now.n, now.e, now.d]),
            np.array([now.vn, now.ve, now.vd]),
            np.array(now.q),
            connected=connected,
            armed=px4.commander.armed,
            mode=px4.commander.mode,
            landed=px4.landed_state,
            armable=px4.commander.ready,
            local_position_ok=px4.commander.ready,
            battery_fraction=max(0.0, 1.0 - self._flown_s * BATTERY_DRAIN_1_S),
        )
