"""One MAVSDK instance on one address: opening, the checks that MAVSDK leaves out, raw messages, and closing.

MAVSDK calls an address good that can never work (a UDP port that another program holds, a serial port that is not
there later), writes its log to standard output, and leaves cancelled commands running. This module owns those edges
for the autopilot's link and for the phone's; it knows nothing of either's messages.
"""

from __future__ import annotations

import asyncio
import errno
import functools
import json
import math
import os
import re
import socket
import stat
from collections.abc import AsyncGenerator
from contextlib import aclosing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.mavlink_direct_server import MavlinkDirectServerAsync, MavlinkMessage
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe

from app.errors import AlightError
from app.log import get_logger

COMPONENT_ID = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""

Fields = dict[str, Any]
_NETWORK = re.compile(r"^(?P<kind>udpin|udpout|tcpin|tcpout)://(?P<host>[^:/]*):(?P<port>\d{1,5})$")
_SERIAL = re.compile(r"^serial(_flowcontrol)?://(?P<device>[^:]+)(:(?P<baud>\d+))?$")
_log = get_logger("mavsdk")


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A MAVLink message as it came in.

    Attributes:
        name: As in the MAVLink definition: "ATTITUDE_QUATERNION".
        system_id: Of the sender.
        component_id: Of the sender.
        fields: By their MAVLink names; NaN is None.
    """

    name: str
    system_id: int
    component_id: int
    fields: Fields


def _to_log(level: LogLevel, message: str, file: str | None, line: int) -> bool:
    """Keep MAVSDK's own log off standard output. Runs on MAVSDK's threads, so nothing may escape."""
    try:
        _log.debug("mavsdk.logged", level=level.name.lower(), message=message)
    except Exception:  # the stream may be closed while the process ends
        return True
    return True


@functools.cache
def _redirect_log() -> None:
    """Once a process: replacing the callback would free it under a thread of another instance that is in it."""
    log_subscribe(_to_log)


def check_address(address: str, error: type[AlightError]) -> None:
    """Try an address before MAVSDK does, since MAVSDK reports success for one that can't work.

    Raises:
        AlightError: Of the kind given: a malformed address, a UDP or TCP port in use, a serial port that is missing,
            is no device, may not be opened or is held by another program.
    """
    network = _NETWORK.match(address)
    if network is not None:
        _check_network(address, network["kind"], network["host"], int(network["port"]), error)
        return
    serial = _SERIAL.match(address)
    if serial is None:
        raise error(f"{address}: not an address", "write udpin://HOST:PORT, udpout://HOST:PORT or serial://DEVICE:BAUD")
    _check_serial(address, Path(serial["device"]), error)


def _check_network(address: str, kind: str, host: str, port: int, error: type[AlightError]) -> None:
    if not 0 < port < 65536:
        raise error(f"{address}: port {port} is outside 1..65535", "mend the address")
    if kind not in ("udpin", "tcpin"):
        return
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM)
    with probe:
        try:
            probe.bind((host, port))
        except OSError as fault:
            if fault.errno == errno.EADDRINUSE:
                raise error(
                    f"{address}: another program holds port {port}", "end that program or give another port"
                ) from None
            raise error(
                f"{address}: can't listen there ({fault.strerror or fault})", "give an address of this machine"
            ) from None


def _check_serial(address: str, device: Path, error: type[AlightError]) -> None:
    try:
        mode = device.stat().st_mode
    except OSError:
        near = sorted(
            str(p) for pattern in ("ttyAMA*", "ttyACM*", "ttyUSB*", "serial*") for p in Path("/dev").glob(pattern)
        )
        there = f"present here: {', '.join(near)}" if near else "no serial port is present: enable it or plug it in"
        raise error(f"{address}: {device} does not exist", there) from None
    if not stat.S_ISCHR(mode):
        raise error(f"{address}: {device} is no serial port", "give the device file of a serial port")
    try:
        os.close(os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))
    except PermissionError:
        raise error(f"{address}: no permission to open {device}", "add this user to the group dialout") from None
    except OSError as fault:
        raise error(
            f"{address}: {device} can't be opened ({fault.strerror})", "end the program that holds it, or replug it"
        ) from None


def encode(fields: Fields) -> str:
    """MAVLink fields as the JSON that MAVSDK takes, in which NaN is null."""
    clean = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in fields.items()}
    return json.dumps(clean)


class MavsdkSession:
    """A MAVSDK instance that is component 191 of a system, with one connection.

    Args:
        address: As in the configuration.
        system_id: Ours, which must be the drone's.
        error: The kind of AlightError that a fault of this link is.
    """

    def __init__(self, address: str, system_id: int, error: type[AlightError]) -> None:
        self.address = address
        self.system_id = system_id
        self._error = error
        self._mavsdk: Mavsdk | None = None
        self._connection: Any = None
        self._server: MavlinkDirectServerAsync | None = None

    @property
    def mavsdk(self) -> Mavsdk:
        """The open instance.

        Raises:
            AlightError: The session is closed.
        """
        if self._mavsdk is None:
            raise self._error(f"{self.address}: the link is closed", "open it first")
        return self._mavsdk

    async def open(self) -> None:
        """Create the instance and its connection.

        Raises:
            AlightError: The address can't work.
        """
        _redirect_log()
        await asyncio.to_thread(check_address, self.address, self._error)
        configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
        configuration.system_id, configuration.component_id = self.system_id, COMPONENT_ID
        self._mavsdk = Mavsdk(configuration)
        try:
            await self._connect()
        except BaseException:
            await self.close()
            raise

    async def _connect(self) -> None:
        try:
            self._connection = await self.mavsdk.add_any_connection(self.address)
        except MavsdkError as fault:
            raise self._error(f"{self.address}: MAVSDK can't open it ({fault})", "check the address") from None

    async def reconnect(self) -> bool:
        """Close and open the connection: MAVSDK never re-opens a serial port that failed. False if it is not there."""
        if self._connection is not None:
            connection, self._connection = self._connection, None
            await self.mavsdk.remove_connection(connection)
        try:
            await asyncio.to_thread(check_address, self.address, self._error)
            await self._connect()
        except self._error:
            return False
        return True

    async def close(self) -> None:
        """Destroy the instance; MAVSDK joins its threads, so not on the event loop. Safe to call twice."""
        mavsdk, self._mavsdk, self._server = self._mavsdk, None, None
        if mavsdk is not None:
            await asyncio.to_thread(mavsdk.destroy)

    async def server(self) -> MavlinkDirectServerAsync:
        """The raw message interface of our own component, made at first use.

        Raises:
            AlightError: MAVSDK has no such component.
        """
        if self._server is None:
            component = await self.mavsdk.server_component()
            if component is None:
                raise self._error(f"{self.address}: MAVSDK made no component {COMPONENT_ID}", "reinstall mavsdk 4.1")
            self._server = MavlinkDirectServerAsync(component)
        return self._server


async def messages(
    source: MavlinkDirectAsync | MavlinkDirectServerAsync, name: str
) -> AsyncGenerator[RawMessage, None]:
    """Messages of one name, as they come. Never ends by itself: cancel it."""
    async with aclosing(source.subscribe_message(name)) as stream:
        async for message in stream:
            yield decoded(message)


def decoded(message: MavlinkMessage) -> RawMessage:
    """A message of MAVSDK's as values."""
    return RawMessage(message.message_name, message.system_id, message.component_id, json.loads(message.fields_json))
