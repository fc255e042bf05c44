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
from dataclasses import replace
from pathlib import Path

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync, ActionError
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mavlink_direct import MavlinkMessage

from app.config import PadMotionConfig, WorldConfig
from app.service import Verdict, check_rig
from app.wiring import Rig, load_shipped_rig, parameter_check
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


@pytest.mark.parametrize(
    ("mode", "verdict"), [("refuse", Verdict.FAULT), ("warn", Verdict.NOTE)], ids=["refuse", "warn"]
)
async def test_check_tells_each_parameter_of_px4_that_differs(
    hangar: Hangar, tmp_path: Path, mode: str, verdict: Verdict
) -> None:
    found = await check_rig(_rig(hangar, tmp_path, mode), 0.5)
    told = {words.split()[0]: (verdict, words) for part, verdict, words in found if part == "parameters"}
    # What PX4's own defaults lack of deploy/px4/alight.params, and nothing else.
    assert sorted(told) == [
        "BAT_CRIT_THR", "BAT_EMERGEN_THR", "BAT_LOW_THR", "COM_DISARM_LAND", "COM_DISARM_PRFLT", "COM_LOW_BAT_ACT",
        "COM_OF_LOSS_T", "COM_RC_IN_MODE", "COM_RC_OVERRIDE", "GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST",
        "RTL_CONE_ANG", "RTL_RETURN_ALT",
    ]  # fmt: skip
    assert {v for v, _ in told.values()} == {verdict}
    assert told["COM_LOW_BAT_ACT"][1].startswith("COM_LOW_BAT_ACT is 0, deploy/px4/alight.params says 3: Battery")


async def test_check_of_a_px4_with_the_shipped_parameters_finds_them_right(hangar: Hangar, tmp_path: Path) -> None:
    rig = _rig(hangar, tmp_path, "refuse")
    check = parameter_check(rig)
    assert check is not None
    for wanted in check.wanted:
        assert hangar.world.px4.params.set(wanted.name, wanted.value)
    found = [(verdict, words) for part, verdict, words in await check_rig(rig, 0.5) if part == "parameters"]
    assert found == [(Verdict.OK, "PX4's failsafes are set as deploy/px4/alight.params says")]


def _rig(hangar: Hangar, folder: Path, mode: str) -> Rig:
    rig = load_shipped_rig("sitl.toml")
    autopilot = rig.config.autopilot.model_copy(
        update={"address": f"udpin://127.0.0.1:{hangar.port}", "check_parameters": mode}
    )
    recorder = rig.config.recorder.model_copy(update={"directory": str(folder)})
    operator = rig.config.operator.model_copy(update={"address": ""})
    update = {"autopilot": autopilot, "recorder": recorder, "operator": operator}
    return replace(rig, config=rig.config.model_copy(update=update))
