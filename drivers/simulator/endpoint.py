"""PX4's side of a MAVLink link, on a UDP socket: streams telemetry, answers commands, parameters and time sync.

It is polled by whoever owns the time (process.py); it never blocks and holds no state of the flight. Rates without
asking are PX4's for a companion (MAVLINK_MODE_ONBOARD) or a ground station.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from app.messages import FlightMode
from drivers.simulator.commander import Result
from drivers.simulator.controller import Demand
from drivers.simulator.param_server import ParamServer
from drivers.simulator.px4 import Px4
from drivers.simulator.telemetry import HOME_ALTITUDE_M, Telemetry, mode_of

SYSTEM_ID = 1
COMPONENT_ID = mavlink.MAV_COMP_ID_AUTOPILOT1
FORCE = 21196
"""Param 2 of MAV_CMD_COMPONENT_ARM_DISARM that overrides the checks."""
RATE_MAX_HZ = 100.0

ONBOARD_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 30.0,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
}
GROUND_STATION_HZ: dict[int, float] = {
    **{number: min(hz, 10.0) for number, hz in ONBOARD_HZ.items()},
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 0.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 0.0,
}
"""A quiet version: a phone's radio carries a few kilobytes a second."""


def _whole(value: float) -> int:
    """A command's parameter as a whole number; what is left out (NaN) is 0."""
    return round(value) if math.isfinite(value) else 0


class Endpoint:
    """One link.

    Args:
        px4: The flight controller behind it.
        remote: (host, port) that it sends to from the start, as PX4 does.
        local_port: Where it listens; 0 takes any.
        ground_station: A ground station's rates and texts, instead of a companion's.

    Attributes:
        address: (host, port) where it listens.
        heard: Messages received so far.
    """

    def __init__(self, px4: Px4, remote: tuple[str, int], local_port: int = 0, *, ground_station: bool = False) -> None:
        self._px4 = px4
        self._telemetry = Telemetry(px4)
        self._params = ParamServer(px4.params)
        self._remote = remote
        self._mav = mavlink.MAVLink(None, SYSTEM_ID, COMPONENT_ID)
        self._mav.robust_parsing = True
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(("127.0.0.1", local_port))
        self._tells = ground_station
        self._rates = dict(GROUND_STATION_HZ if ground_station else ONBOARD_HZ)
        self._default_rates = dict(self._rates)
        self._due = dict.fromkeys(self._rates, 0.0)
        self._told = 0
        self.address: tuple[str, int] = self._socket.getsockname()
        self.heard = 0
        self._handlers: dict[str, Callable[[Any], None]] = {
            "COMMAND_LONG": self._on_command_long,
            "COMMAND_INT": self._on_command_int,
            "SET_MODE": self._on_set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": self._on_setpoint,
            "TIMESYNC": self._on_timesync,
            "PARAM_REQUEST_READ": self._on_param_read,
            "PARAM_REQUEST_LIST": self._on_param_list,
            "PARAM_SET": self._on_param_set,
            "MISSION_REQUEST_LIST": self._on_mission_list,
        }

    def fileno(self) -> int:
        """For select."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    # --------------------------------------------------------------------------------------------------- streaming
    def tick(self) -> None:
        """Send what is due."""
        now_s = self._px4.uptime_s
        builders = self._telemetry.builders
        for number, rate in self._rates.items():
            if rate <= 0.0 or now_s < self._due[number]:
                continue
            # On a grid, so that jitter of the caller doesn't lower the rate; but no burst after a pause.
            self._due[number] = max(self._due[number] + 1.0 / rate, now_s - 1.0 / rate)
            self._send(builders[number]())
        if self._tells:
            self._say()

    def _say(self) -> None:
        """Pass on what the flight controller tells: to a ground station only, as PX4 does."""
        for text in self._px4.commander.texts:
            if text.number > self._told:
                self._told = text.number
                self._send(mavlink.MAVLink_statustext_message(text.severity, text.text.encode("ascii", "replace")))

    def _send(self, message: Any) -> None:
        packet = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        try:
            self._socket.sendto(packet, self._remote)
        except (BlockingIOError, ConnectionRefusedError):
            return  # as a radio: nobody listens, or the buffer is full

    # --------------------------------------------------------------------------------------------------- receiving
    def poll(self) -> None:
        """Handle everything that has arrived."""
        while True:
            try:
                packet, sender = self._socket.recvfrom(2048)
            except BlockingIOError:
                return
            except ConnectionRefusedError:
                continue
            self._remote = sender
            for message in self._mav.parse_buffer(packet) or ():
                self.heard += 1
                handler = self._handlers.get(message.get_type())
                if handler is not None and self._is_for_us(message):
                    handler(message)

    @staticmethod
    def _is_for_us(message: Any) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, SYSTEM_ID) and component in (0, COMPONENT_ID)

    def _on_command_int(self, message: Any) -> None:
        x, y = message.x, message.y
        values = [message.param1, message.param2, message.param3, message.param4, x / 1e7, y / 1e7, message.z]
        self._answer(message, message.command, self._execute(message.command, values))

    def _on_command_long(self, message: Any) -> None:
        values = [getattr(message, f"param{k}") for k in range(1, 8)]
        self._answer(message, message.command, self._execute(message.command, values))

    def _answer(self, message: Any, command: int, result: Result) -> None:
        self._send(
            mavlink.MAVLink_command_ack_message(
                command, int(result), 255, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )

    def _execute(self, command: int, values: list[float]) -> Result:
        """Do what a command asks; its MAV_RESULT."""
        px4 = self._px4
        match command:
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                force = _whole(values[1]) == FORCE
                return px4.arm(force) if _whole(values[0]) == 1 else px4.disarm(force)
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                return px4.takeoff(values[6] - HOME_ALTITUDE_M if math.isfinite(values[6]) else None)
            case mavlink.MAV_CMD_NAV_LAND:
                return px4.set_mode(FlightMode.LAND)
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                return px4.set_mode(FlightMode.RETURN)
            case mavlink.MAV_CMD_DO_SET_MODE:
                return self._set_mode(_whole(values[1]), _whole(values[2]))
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                return self._set_interval(_whole(values[0]), values[1])
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                return self._request(_whole(values[0]))
            case mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
                return self._request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
            case mavlink.MAV_CMD_GET_HOME_POSITION:
                return self._request(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
        return Result.UNSUPPORTED

    def _set_mode(self, main: int, sub: int) -> Result:
        mode = mode_of(main, sub)
        return Result.TEMPORARILY_REJECTED if mode is None else self._px4.set_mode(mode)

    def _set_interval(self, number: int, interval_us: float) -> Result:
        if number not in self._telemetry.builders or number == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return Result.FAILED
        if interval_us > 0:
            rate = min(RATE_MAX_HZ, 1e6 / interval_us)
        else:
            rate = self._default_rates.get(number, 0.0) if _whole(interval_us) == 0 else 0.0
        self._rates[number] = rate
        self._due[number] = self._px4.uptime_s
        return Result.ACCEPTED

    def _request(self, number: int) -> Result:
        builder = self._telemetry.builders.get(number)
        if builder is None:
            return Result.DENIED
        self._send(builder())
        return Result.ACCEPTED

    def _on_set_mode(self, message: Any) -> None:
        self._set_mode(message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24 & 0xFF)

    def _on_setpoint(self, message: Any) -> None:
        """A setpoint in the local frame; the bits of type_mask that are set mark what to ignore."""
        if message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
            return
        mask = message.type_mask

        def field(name: str, bit: int) -> float:
            return math.nan if mask & bit else float(getattr(message, name))

        self._px4.offboard_setpoint(
            Demand(
                (field("x", 1), field("y", 2), field("z", 4)),
                (field("vx", 8), field("vy", 16), field("vz", 32)),
                (field("afx", 64), field("afy", 128), field("afz", 256)),
                field("yaw", 1024),
                field("yaw_rate", 2048),
            )
        )

    def _on_timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            self._send(mavlink.MAVLink_timesync_message(int(self._px4.uptime_s * 1e9), message.ts1))

    def _on_param_read(self, message: Any) -> None:
        answer = self._params.read(message.param_id, message.param_index)
        if answer is not None:
            self._send(answer)

    def _on_param_list(self, _: Any) -> None:
        for answer in self._params.everything():
            self._send(answer)

    def _on_param_set(self, message: Any) -> None:
        answer = self._params.write(message.param_id, message.param_value, message.param_type)
        if answer is not None:
            self._send(answer)

    def _on_mission_list(self, message: Any) -> None:
        self._send(
            mavlink.MAVLink_mission_count_message(
                message.get_srcSystem(), message.get_srcComponent(), 0, message.mission_type
            )
        )
