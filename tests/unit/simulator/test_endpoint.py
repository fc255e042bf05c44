"""The MAVLink endpoint, spoken to with pymavlink over loopback; the test owns the time."""

from __future__ import annotations

import math
import select
import socket
import struct
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from app.config import PadMotionConfig, WorldConfig
from app.messages import FlightMode
from drivers.simulator.endpoint import Endpoint
from drivers.simulator.world import World


class Companion:
    """A world with a link, and the other end of it."""

    def __init__(self, *, ground_station: bool = False) -> None:
        self.world = World(WorldConfig(motion=PadMotionConfig(north_m=300.0)), 0.0)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.link = Endpoint(self.world.px4, self.socket.getsockname(), ground_station=ground_station)
        self.mav = mavlink.MAVLink(None, 1, 191)
        self.mav.robust_parsing = True

    def send(self, message: Any) -> None:
        self.socket.sendto(message.pack(self.mav), self.link.address)
        assert select.select([self.link], [], [], 2.0)[0]
        self.link.poll()

    def received(self) -> list[Any]:
        messages: list[Any] = []
        while select.select([self.socket], [], [], 0.0)[0]:
            messages += self.mav.parse_buffer(self.socket.recv(4096)) or []
        return messages

    def run(self, seconds: float) -> list[Any]:
        messages: list[Any] = []
        for _ in range(round(seconds / 0.004)):
            self.world.step()
            self.link.tick()
            messages += self.received()
        return messages

    def command(self, number: int, *params: float) -> int:
        values = (list(params) + [0.0] * 7)[:7]
        self.received()
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))
        (ack,) = [m for m in self.received() if m.get_type() == "COMMAND_ACK"]
        assert ack.command == number
        assert (ack.target_system, ack.target_component) == (1, 191)
        return int(ack.result)

    def velocity(self, *velocity: float, mask: int = 2503) -> None:
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, mask, 0, 0, 0, *velocity, 0, 0, 0, 0.0, 0.0
            )
        )

    def close(self) -> None:
        self.link.close()
        self.socket.close()


@pytest.fixture
def companion() -> Iterator[Companion]:
    one = Companion()
    yield one
    one.close()


def rates(messages: list[Any], seconds: float) -> dict[str, float]:
    return {name: count / seconds for name, count in Counter(m.get_type() for m in messages).items()}


def test_endpoint_streams_at_px4s_rates_without_being_asked(companion: Companion) -> None:
    companion.run(0.1)
    measured = rates(companion.run(4.0), 4.0)
    expected = {"HEARTBEAT": 1, "ATTITUDE_QUATERNION": 50, "LOCAL_POSITION_NED": 30, "ODOMETRY": 30}
    expected |= {"EXTENDED_SYS_STATE": 5, "SYS_STATUS": 5, "HOME_POSITION": 0.5}
    assert {name: measured[name] for name in expected} == pytest.approx(expected, rel=0.06, abs=0.26)


def test_endpoint_sends_a_message_at_the_interval_that_was_asked(companion: Companion) -> None:
    number = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    assert companion.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 10_000.0) == 0
    assert rates(companion.run(2.0), 2.0)["LOCAL_POSITION_NED"] == pytest.approx(100.0, rel=0.03)
    assert companion.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, -1.0) == 0
    assert "LOCAL_POSITION_NED" not in rates(companion.run(1.0), 1.0)
    assert companion.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 0.0) == 0
    assert rates(companion.run(2.0), 2.0)["LOCAL_POSITION_NED"] == pytest.approx(30.0, rel=0.05)


def test_endpoint_refuses_an_interval_of_a_message_it_has_not(companion: Companion) -> None:
    assert companion.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 12345.0, 10_000.0) != 0


def test_endpoint_times_its_messages_by_its_own_uptime(companion: Companion) -> None:
    messages = [m for m in companion.run(1.0) if m.get_type() == "ATTITUDE_QUATERNION"]
    stamps = [m.time_boot_ms for m in messages]
    assert stamps[-1] == pytest.approx(1000, abs=25)
    assert all(b - a in (19, 20, 21, 24, 16) for a, b in pairwise(stamps))


def test_endpoint_raises_the_prearm_bit_when_arming_is_allowed(companion: Companion) -> None:
    def bits(messages: list[Any]) -> list[bool]:
        health = [m.onboard_control_sensors_health for m in messages if m.get_type() == "SYS_STATUS"]
        return [bool(h & mavlink.MAV_SYS_STATUS_PREARM_CHECK) for h in health]

    assert not any(bits(companion.run(2.8)))
    assert bits(companion.run(1.0))[-1]


def test_endpoint_flies_a_whole_flight_by_commands(companion: Companion) -> None:
    assert companion.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    companion.run(3.2)
    assert companion.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == 0
    up = 488.0 + 3.0
    assert companion.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, math.nan, math.nan, up) == 0
    companion.run(10.0)
    assert -companion.world.px4.estimate.d == pytest.approx(3.0, abs=0.15)
    assert companion.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    for _ in range(30):
        companion.velocity(1.0, 0.0, 0.0)
        companion.run(0.02)
    assert companion.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0) == 0
    for _ in range(150):
        companion.velocity(1.0, 0.0, 0.0)
        companion.run(0.02)
    messages = companion.run(0.4)
    position = [m for m in messages if m.get_type() == "LOCAL_POSITION_NED"][-1]
    assert position.vx == pytest.approx(1.0, abs=0.1)
    assert companion.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) != 0
    assert companion.command(mavlink.MAV_CMD_NAV_LAND) == 0
    messages = companion.run(14.0)
    landed = [m.landed_state for m in messages if m.get_type() == "EXTENDED_SYS_STATE"]
    assert landed[0] == mavlink.MAV_LANDED_STATE_LANDING
    assert landed[-1] == mavlink.MAV_LANDED_STATE_ON_GROUND
    heartbeat = [m for m in messages if m.get_type() == "HEARTBEAT"][-1]
    assert not heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


@pytest.mark.parametrize(
    ("mode", "main", "sub"),
    [
        (FlightMode.ALTITUDE, 2, 0),
        (FlightMode.POSITION, 3, 0),
        (FlightMode.HOLD, 4, 3),
        (FlightMode.RETURN, 4, 5),
        (FlightMode.LAND, 4, 6),
    ],
)
def test_endpoint_tells_px4s_numbers_of_each_mode(companion: Companion, mode: FlightMode, main: int, sub: int) -> None:
    assert companion.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub) == 0
    assert companion.world.px4.commander.mode is mode
    heartbeat = [m for m in companion.run(1.1) if m.get_type() == "HEARTBEAT"][-1]
    assert heartbeat.custom_mode == main << 16 | sub << 24
    assert heartbeat.autopilot == mavlink.MAV_AUTOPILOT_PX4


def test_endpoint_refuses_a_mode_that_it_cannot_fly(companion: Companion) -> None:
    assert companion.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 9) != 0
    assert companion.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 77, 0) != 0


def test_endpoint_kills_by_the_forced_disarm(companion: Companion) -> None:
    companion.run(3.2)
    companion.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    companion.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, math.nan)
    companion.run(8.0)
    assert companion.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0) == 0
    assert not companion.world.px4.commander.armed


def test_endpoint_answers_unknown_and_nonsense_commands_and_lives_on(companion: Companion) -> None:
    assert companion.command(31010, 1.0) == mavlink.MAV_RESULT_UNSUPPORTED
    assert companion.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, math.nan, math.inf) == 0
    assert companion.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, math.nan, math.nan) != 0
    companion.socket.sendto(bytes(range(200)), companion.link.address)
    companion.socket.sendto(b"", companion.link.address)
    assert companion.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148.0) == 0


def test_endpoint_ignores_commands_to_others(companion: Companion) -> None:
    companion.run(3.2)
    companion.send(mavlink.MAVLink_command_long_message(2, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    companion.send(mavlink.MAVLink_command_long_message(1, 191, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert not companion.world.px4.commander.armed


@pytest.mark.parametrize(
    ("mask", "free"),
    [
        (2503, ("position", "acceleration")),
        (2055, ("position",)),
        (2496, ("acceleration",)),
        (2048, ()),
    ],
)
def test_endpoint_reads_a_setpoints_mask(companion: Companion, mask: int, free: tuple[str, ...]) -> None:
    companion.send(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, mask, 1.0, 2.0, -3.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8
        )
    )
    demand = companion.world.px4._offboard
    assert demand is not None
    for name, values in (
        ("position", (1.0, 2.0, -3.0)),
        ("velocity", (0.1, 0.2, 0.3)),
        ("acceleration", (0.4, 0.5, 0.6)),
    ):
        expected = [math.nan] * 3 if name in free else values
        assert getattr(demand, name) == pytest.approx(expected, nan_ok=True, rel=1e-6)
    assert demand.yaw == pytest.approx(0.7, rel=1e-6)
    assert math.isnan(demand.yaw_rate)


def test_endpoint_ignores_setpoints_in_other_frames(companion: Companion) -> None:
    companion.send(
        mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 8, 2503, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0)
    )
    assert companion.world.px4._offboard is None


def test_endpoint_answers_time_sync_with_its_own_time(companion: Companion) -> None:
    companion.run(0.5)
    companion.received()
    companion.send(mavlink.MAVLink_timesync_message(0, 123456789))
    (answer,) = [m for m in companion.received() if m.get_type() == "TIMESYNC"]
    assert answer.ts1 == 123456789
    assert answer.tc1 == pytest.approx(0.5e9, rel=1e-6)


def test_endpoint_serves_parameters_by_name_with_integers_as_bytes(companion: Companion) -> None:
    companion.received()
    companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OBL_RC_ACT", -1))
    (value,) = [m for m in companion.received() if m.get_type() == "PARAM_VALUE"]
    assert value.param_type == mavlink.MAV_PARAM_TYPE_INT32
    assert struct.unpack("<i", struct.pack("<f", value.param_value))[0] == 5
    as_float = struct.unpack("<f", struct.pack("<i", 4))[0]
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", as_float, mavlink.MAV_PARAM_TYPE_INT32))
    assert companion.world.px4.params["COM_OBL_RC_ACT"] == 4
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", 0.5, mavlink.MAV_PARAM_TYPE_REAL32))
    assert companion.world.px4.params["COM_OF_LOSS_T"] == 0.5


def test_endpoint_lists_all_parameters(companion: Companion) -> None:
    companion.received()
    companion.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values = [m for m in companion.received() if m.get_type() == "PARAM_VALUE"]
    assert [v.param_index for v in values] == list(range(values[0].param_count))


@pytest.mark.parametrize("ground_station", [True, False])
def test_endpoint_says_its_texts_to_a_ground_station_only(ground_station: bool) -> None:
    one = Companion(ground_station=ground_station)
    one.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    texts = [m.text for m in one.run(0.1) if m.get_type() == "STATUSTEXT"]
    one.close()
    assert texts == (["Arming denied: vehicle is not ready"] if ground_station else [])


def test_endpoint_tells_nothing_of_the_truth() -> None:
    """With the errors of the estimate on, what it sends is the estimate."""
    one = Companion()
    one.world = World(WorldConfig(seed=3, motion=PadMotionConfig(north_m=300.0)), 3.0)
    one.link.close()
    one.link = Endpoint(one.world.px4, one.socket.getsockname())
    messages = one.run(20.0)
    one.close()
    position = [m for m in messages if m.get_type() == "LOCAL_POSITION_NED"][-1]
    body = one.world.plant.body
    assert math.dist((position.x, position.y), (body.n, body.e)) > 0.05
    assert not {m.get_type() for m in messages} & {"HIL_STATE_QUATERNION", "SIM_STATE", "SIMSTATE"}
