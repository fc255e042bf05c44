"""The real mavsdk flies the simulator's endpoint: connect, arm, take off, offboard, land, disarm.

The world runs four times as fast as the clock, so that the flight is short; mavsdk doesn't mind.
"""

from __future__ import annotations

import asyncio
import json
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import aclosing

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync, ActionError
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mavlink_direct import MavlinkMessage

from app.config import PadMotionConfig, WorldConfig
from drivers.simulator.endpoint import Endpoint
from drivers.simulator.world import STEP_S, World

SPEED = 4.0


class Hangar:
    """A world and its link in a thread of their own."""

    def __init__(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = int(probe.getsockname()[1])
        self.world = World(WorldConfig(motion=PadMotionConfig(north_m=300.0)))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        link = Endpoint(self.world.px4, ("127.0.0.1", self.port))
        start_s = time.monotonic()
        while not self._stop.is_set():
            link.poll()
            while self.world.t_s < SPEED * (time.monotonic() - start_s):
                self.world.step()
                link.tick()
            select.select([link], [], [], STEP_S / SPEED)
        link.close()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def hangar() -> Iterator[Hangar]:
    one = Hangar()
    yield one
    one.close()


async def test_simulated_px4_flown_by_mavsdk_takes_off_obeys_velocities_and_lands(hangar: Hangar) -> None:
    configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
    configuration.system_id, configuration.component_id = 1, 191
    async with asyncio.timeout(60.0), Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{hangar.port}")
        system = await mavsdk.first_autopilot(10)
        telemetry, action, direct = TelemetryAsync(system), ActionAsync(system), MavlinkDirectAsync(system)

        async with aclosing(telemetry.subscribe_health()) as stream:
            async for health in stream:
                if health.is_armable and health.is_local_position_ok and health.is_home_position_ok:
                    break
        await telemetry.set_rate_attitude_quaternion(100.0)
        await action.set_takeoff_altitude(2.0)
        assert await action.get_takeoff_altitude() == 2.0
        await action.arm()
        await action.takeoff()
        async with aclosing(telemetry.subscribe_position_velocity_ned()) as stream:
            async for position in stream:
                if position.position.down_m < -1.6:
                    break
        with pytest.raises(ActionError):
            await action.disarm()

        async def fly(*velocity: float) -> None:
            fields = {"coordinate_frame": 1, "type_mask": 2503, "target_system": 1, "target_component": 1, "yaw": 0.0}
            fields |= dict(zip(("vx", "vy", "vz"), velocity, strict=True)) | {"time_boot_ms": 0}
            message = MavlinkMessage("SET_POSITION_TARGET_LOCAL_NED", 0, 0, 1, 1, json.dumps(fields))
            await direct.send_message(message)

        offboard = {"command": 176, "param1": 1, "param2": 6, "param3": 0, "target_system": 1, "target_component": 1}
        accepted = False
        async with aclosing(telemetry.subscribe_position_velocity_ned()) as stream:
            async for position in stream:
                await fly(2.0, 0.0, 0.0)
                if not accepted:
                    ack = await direct.send_command(MavlinkMessage("COMMAND_LONG", 0, 0, 1, 1, json.dumps(offboard)))
                    accepted = json.loads(ack.fields_json)["result"] == 0
                if position.velocity.north_m_s > 1.8:
                    break
        await action.land()
        async with aclosing(telemetry.subscribe_armed()) as stream:
            async for armed in stream:
                if not armed:
                    break
    assert hangar.world.plant.crashed is None
    assert [contact.kind for contact in hangar.world.contacts] == ["touchdown", "rest"]
