"""An independent ground station for the terminal: gives Alight one order over UDP and tells what comes back.

It speaks MAVLink through pymavlink and shares nothing with the link it talks to.
"""

from __future__ import annotations

import contextlib
import math
import re
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from app.errors import OperatorError
from app.messages import CommandResult, OperatorAction

GROUND_STATION = (255, 190)
"""Our (system id, component id)."""
ALIGHT_COMPONENT = 191
ACTION_COMMAND = 31010
RESEND_S = 1.0
HEARTBEAT_S = 1.0
_ADDRESS = re.compile(r"^(udpin|udpout)://(?P<host>[^:/]*):(?P<port>\d{1,5})$")
_RESULTS = {result.value: result for result in CommandResult}


@dataclass(frozen=True, slots=True)
class PhoneProgress:
    """The order is being carried out.

    Attributes:
        percent: As Alight puts it.
    """

    percent: int


@dataclass(frozen=True, slots=True)
class PhoneText:
    """A line from Alight for the screen.

    Attributes:
        text: At most 50 characters.
        severity: MAV_SEVERITY: 0 emergency to 7 debug.
    """

    text: str
    severity: int


@dataclass(frozen=True, slots=True)
class PhoneResult:
    """The final answer."""

    result: CommandResult


PhoneEvent = PhoneProgress | PhoneText | PhoneResult


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the phone asks for.

    Attributes:
        action: To do.
        height_m: Height above the pad to track at; None for the configured one.
        pad_speed_m_s: Of a pad that drives; None: it may stand anywhere near.
        pad_heading_deg: Which way, clockwise from north.
    """

    action: OperatorAction
    height_m: float | None = None
    pad_speed_m_s: float | None = None
    pad_heading_deg: float | None = None


class _Station:
    """A UDP socket that speaks MAVLink to one address."""

    def __init__(self, address: str) -> None:
        match = _ADDRESS.match(address)
        if match is None or not 0 < int(match["port"]) < 65536:
            raise OperatorError(f"{address}: not a UDP address", "write the rig's operator address, udpin://HOST:PORT")
        host = match["host"]
        self.address = address
        self._mav: Any = mavlink.MAVLink(None, srcSystem=GROUND_STATION[0], srcComponent=GROUND_STATION[1])
        self._mav.robust_parsing = True
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            # A link that listens on every address is reached on this machine's own.
            self._socket.connect(("127.0.0.1" if host in ("", "0.0.0.0") else host, int(match["port"])))
        except OSError as fault:
            self._socket.close()
            raise OperatorError(f"{address}: can't be reached ({fault.strerror or fault})", "check the host") from None

    def close(self) -> None:
        self._socket.close()

    def send(self, message: Any) -> None:
        # A refused datagram (nobody listens yet) is an ICMP error of an earlier send: no answer says it better.
        with contextlib.suppress(ConnectionRefusedError):
            self._socket.send(message.pack(self._mav))

    def receive(self, timeout_s: float) -> list[Any]:
        """Messages that arrive within a time; empty if none does."""
        self._socket.settimeout(max(0.001, timeout_s))
        started_s = time.monotonic()
        try:
            data = self._socket.recv(4096)
        except TimeoutError:
            return []
        except ConnectionRefusedError:
            time.sleep(min(0.1, max(0.0, timeout_s - (time.monotonic() - started_s))))
            return []
        return [m for m in self._mav.parse_buffer(data) or [] if m.get_type() != "BAD_DATA"]

    def heartbeat(self) -> Any:
        return self._mav.heartbeat_encode(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE
        )

    def order(self, system_id: int, wanted: Wanted, confirmation: int) -> Any:
        values = (wanted.height_m, wanted.pad_speed_m_s, wanted.pad_heading_deg)
        given = (math.nan if value is None else value for value in values)
        return self._mav.command_long_encode(
            system_id, ALIGHT_COMPONENT, ACTION_COMMAND, confirmation, float(wanted.action), *given, *(math.nan,) * 3
        )


def send_command(
    address: str,
    wanted: Wanted,
    *,
    timeout_s: float = 5.0,
    linger_s: float = 0.5,
) -> Iterator[PhoneEvent]:
    """Give an order and tell what comes back, until the final answer.

    Args:
        address: The rig's operator address (udpin://HOST:PORT), or udpout:// to another machine.
        wanted: What is asked.
        timeout_s: Longest silence: to the first answer, and between two.
        linger_s: How long to listen for more lines after the final answer.

    Yields:
        PhoneProgress whenever the percentage changes, PhoneText, and in the end one PhoneResult.

    Raises:
        OperatorError: Nobody answers at the address, or the answers cease.
    """
    station = _Station(address)
    try:
        yield from _converse(station, wanted, timeout_s, linger_s)
    finally:
        station.close()


def _converse(station: _Station, wanted: Wanted, timeout_s: float, linger_s: float) -> Iterator[PhoneEvent]:
    start_s = heard_s = time.monotonic()
    next_beat_s = start_s
    next_order_s = math.inf
    system_id, confirmation, percent = 0, 0, -1
    answered = False
    result: PhoneResult | None = None
    end_s = math.inf
    while (now_s := time.monotonic()) < end_s:
        if now_s >= next_beat_s:
            station.send(station.heartbeat())
            next_beat_s = now_s + HEARTBEAT_S
        if now_s >= next_order_s:
            station.send(station.order(system_id, wanted, confirmation))
            confirmation, next_order_s = confirmation + 1, now_s + RESEND_S
        if result is None and now_s - heard_s > timeout_s:
            raise _silence(station.address, timeout_s, found=system_id != 0, answered=answered)
        for message in station.receive(min(next_beat_s, next_order_s, end_s, heard_s + timeout_s) - now_s):
            kind, source = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
            if source[1] != ALIGHT_COMPONENT or (system_id and source[0] != system_id):
                continue
            if kind == "HEARTBEAT" and system_id == 0:
                # The order names the drone's system: its heartbeat tells it.
                system_id, next_order_s, heard_s = source[0], time.monotonic(), time.monotonic()
            elif kind == "STATUSTEXT":
                yield PhoneText(str(message.text), int(message.severity))
            elif kind == "COMMAND_ACK" and _for_us(message) and result is None:
                heard_s, answered, next_order_s = time.monotonic(), True, math.inf
                known = _RESULTS.get(int(message.result), CommandResult.FAILED)
                if known is not CommandResult.IN_PROGRESS:
                    result, end_s = PhoneResult(known), heard_s + linger_s
                elif int(message.progress) != percent:
                    percent = int(message.progress)
                    yield PhoneProgress(percent)
    if result is not None:
        yield result


def _for_us(message: Any) -> bool:
    target = (int(message.target_system), int(message.target_component))
    return int(message.command) == ACTION_COMMAND and target in (GROUND_STATION, (0, 0))


def _silence(address: str, timeout_s: float, *, found: bool, answered: bool) -> OperatorError:
    if answered:
        return OperatorError(f"{address}: Alight's answers ceased for {timeout_s:g} s", "see whether it still runs")
    if found:
        return OperatorError(f"{address}: Alight is there and did not answer within {timeout_s:g} s", "see its log")
    return OperatorError(
        f"{address}: nobody answers within {timeout_s:g} s", "start alight run, and give its operator address"
    )
