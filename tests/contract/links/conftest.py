"""An autopilot and a ground station made with pymavlink, on loopback, for the links to talk to."""

from __future__ import annotations

import logging
import math
import queue
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
import structlog
from pymavlink.dialects.v20 import development as mavlink
from pymavlink.generator.mavcrc import x25crc

ARMED, CUSTOM = 128, 1
HOLD_MODE = 4 << 16 | 3 << 24


def free_port() -> int:
    """A UDP port that nobody holds now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Station:
    """A MAVLink component on a UDP socket; a thread reads it into `inbox`, an unbounded queue of (arrival, message).

    It sends to remote_port, or, if that is 0, to whoever it heard last.
    """

    def __init__(self, remote_port: int, system_id: int, component_id: int, local_port: int = 0) -> None:
        self.remote = ("127.0.0.1", remote_port)
        self._replies = remote_port == 0
        self.mav: Any = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", local_port))
        self.socket.settimeout(0.005)
        self.inbox: queue.Queue[tuple[float, Any]] = queue.Queue()
        self.heard: list[tuple[float, Any]] = []
        self.on_message: Callable[[Any], None] = lambda message: None
        self.on_tick: Callable[[], None] = lambda: None
        self._parser: Any = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._end.set()
        self._thread.join(timeout=5)
        self.socket.close()

    def send(self, message: Any) -> None:
        self.socket.sendto(message.pack(self.mav), self.remote)

    def _run(self) -> None:
        while not self._end.is_set():
            self.on_tick()
            try:
                data, sender = self.socket.recvfrom(4096)
            except (TimeoutError, ConnectionRefusedError):
                continue
            if self._replies:
                self.remote = sender
            for message in self._parser.parse_buffer(data) or []:
                self.heard.append((time.monotonic(), message))
                self.on_message(message)
                self.inbox.put((time.monotonic(), message))

    def wait_for(self, kind: str, where: Callable[[Any], bool] = lambda m: True, timeout_s: float = 5.0) -> Any:
        """The next message of a kind from the inbox that satisfies a condition; TimeoutError without one."""
        end_s = time.monotonic() + timeout_s
        while (left_s := end_s - time.monotonic()) > 0:
            try:
                _, message = self.inbox.get(timeout=left_s)
            except queue.Empty:
                break
            if message.get_type() == kind and where(message):
                return message
        raise TimeoutError(f"no {kind} within {timeout_s} s")

    def forget(self) -> None:
        """Empty the inbox."""
        while not self.inbox.empty():
            self.inbox.get_nowait()

    def of_kind(self, kind: str) -> list[tuple[float, Any]]:
        """Everything of a kind that was heard so far, with arrival times."""
        return [(t, m) for t, m in list(self.heard) if m.get_type() == kind]


@dataclass
class Motion:
    """What the autopilot says of the vehicle: a straight flight."""

    pos0: tuple[float, float, float] = (1.0, 2.0, -4.0)
    vel: tuple[float, float, float] = (3.0, 0.0, 0.0)
    jump: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass
class Autopilot:
    """An autopilot that streams telemetry and answers commands with `results` (accepted unless named; None: silence).

    Its boot clock is time.monotonic() - boot_offset_s.
    """

    port: int
    system_id: int = 1
    boot_offset_s: float = field(default_factory=lambda: time.monotonic() - 100.0)
    results: dict[int, int | None] = field(default_factory=dict)
    words: dict[int, str] = field(default_factory=dict)
    motion: Motion = field(default_factory=Motion)
    armed: bool = False
    custom_mode: int = HOLD_MODE
    talking: bool = True
    position_lag_s: float = 0.004
    station: Station = field(init=False)

    def __post_init__(self) -> None:
        self.station = Station(self.port, self.system_id, 1)
        self.station.on_tick = self._tick
        self.station.on_message = self._answer
        self._beat_s = self._slow_s = self._fast_s = -math.inf
        self.station.start()

    def close(self) -> None:
        self.station.close()

    @property
    def commands(self) -> list[Any]:
        return [m for _, m in self.station.of_kind("COMMAND_LONG")]

    @property
    def setpoints(self) -> list[tuple[float, Any]]:
        return self.station.of_kind("SET_POSITION_TARGET_LOCAL_NED")

    def position_at(self, t_s: float) -> tuple[float, ...]:
        """Where the vehicle is at a time of time.monotonic()."""
        dt_s = t_s - self.boot_offset_s
        return tuple(
            p + v * dt_s + j for p, v, j in zip(self.motion.pos0, self.motion.vel, self.motion.jump, strict=True)
        )

    def _tick(self) -> None:
        now_s = time.monotonic()
        if not self.talking:
            return
        mav, send = self.station.mav, self.station.send
        if now_s - self._beat_s >= 0.1:
            self._beat_s = now_s
            mode = (ARMED if self.armed else 0) | CUSTOM
            send(mav.heartbeat_encode(2, mavlink.MAV_AUTOPILOT_PX4, mode, self.custom_mode, 4))
        if now_s - self._slow_s >= 0.1:
            self._slow_s = now_s
            send(mav.extended_sys_state_encode(0, 2))
            send(mav.sys_status_encode(0, 0, 1 << 28, 100, 16000, 100, 80, 0, 0, 0, 0, 0, 0))
            send(mav.estimator_status_encode(0, 831, *(0.1,) * 8))
            send(mav.current_mode_encode(0, self.custom_mode, self.custom_mode))
            send(mav.global_position_int_encode(0, 0, 0, 488_500, 0, 0, 0, 0, 0))
        if now_s - self._fast_s >= 0.01:
            self._fast_s = now_s
            sample_s = now_s - self.position_lag_s
            pos = self.position_at(sample_s)
            boot_ms = 1000.0 * (now_s - self.boot_offset_s)
            send(mav.attitude_quaternion_encode(int(boot_ms), 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            send(mav.local_position_ned_encode(int(boot_ms - 1000 * self.position_lag_s), *pos, *self.motion.vel))

    def _answer(self, message: Any) -> None:
        if message.get_type() != "COMMAND_LONG" or message.target_system != self.system_id:
            return
        result = self.results.get(message.command, 0)
        if result is None:
            return
        mav = self.station.mav
        if message.command in self.words:
            self.station.send(mav.statustext_encode(2, self.words[message.command].encode()))
        target = (message.get_srcSystem(), message.get_srcComponent())
        self.station.send(mav.command_ack_encode(message.command, result, 0, 0, *target))


@pytest.fixture(autouse=True, scope="session")
def _quiet_log() -> None:
    """MAVSDK's own log, at debug, comes from threads that outlive a test's capture."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.INFO))


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def make_autopilot(port: int) -> Iterator[Callable[..., Autopilot]]:
    made: list[Autopilot] = []

    def make(**settings: Any) -> Autopilot:
        made.append(Autopilot(port, **settings))
        return made[-1]

    yield make
    for autopilot in made:
        autopilot.close()


@pytest.fixture
def autopilot(make_autopilot: Callable[..., Autopilot]) -> Autopilot:
    return make_autopilot()


class GroundStation(Station):
    """A phone's app: heartbeats twice a second, and commands by hand."""

    def __init__(self, remote_port: int, system_id: int = 255, component_id: int = 190) -> None:
        super().__init__(remote_port, system_id, component_id)
        self._beat_s = -math.inf
        self.on_tick = self._beat

    def _beat(self) -> None:
        if time.monotonic() - self._beat_s >= 0.5:
            self._beat_s = time.monotonic()
            self.send(self.mav.heartbeat_encode(6, 8, 0, 0, 4))

    def command(
        self, command: int, *params: float, confirmation: int = 0, system: int = 1, component: int = 191
    ) -> None:
        padded = (*params, *(math.nan,) * (7 - len(params)))
        self.send(self.mav.command_long_encode(system, component, command, confirmation, *padded))

    def cancel(self, command: int, *, system: int = 1, component: int = 191) -> None:
        """COMMAND_CANCEL (80), which pymavlink's dialects lack: MAVLink 2, written by its serialisation rules."""
        definition = b"COMMAND_CANCEL uint16_t command uint8_t target_system uint8_t target_component "
        extra = x25crc(definition).crc
        payload = struct.pack("<HBB", command, system, component)
        header = struct.pack("<BBBBBBHB", len(payload), 0, 0, 0, self.mav.srcSystem, self.mav.srcComponent, 80, 0)
        checksum = x25crc(header + payload + bytes([(extra & 0xFF) ^ (extra >> 8)])).crc
        self.socket.sendto(b"\xfd" + header + payload + struct.pack("<H", checksum), self.remote)

    def acks(self, command: int = 31010) -> list[int]:
        """Results answered so far."""
        return [m.result for _, m in self.of_kind("COMMAND_ACK") if m.command == command]

    def wait_for_ack(self, result: int, command: int = 31010, timeout_s: float = 5.0) -> Any:
        return self.wait_for("COMMAND_ACK", lambda m: (m.command, m.result) == (command, result), timeout_s)


@pytest.fixture
def make_ground_station(port: int) -> Iterator[Callable[..., GroundStation]]:
    made: list[GroundStation] = []

    def make(**settings: Any) -> GroundStation:
        station = GroundStation(port, **settings)
        made.append(station)
        station.start()
        return station

    yield make
    for station in made:
        station.close()


@pytest.fixture
def ground_station(make_ground_station: Callable[..., GroundStation]) -> GroundStation:
    return make_ground_station()


class ScriptedAlight(Station):
    """Component 191 that answers each order with the next entry of a script: a MAV_RESULT, or None for silence."""

    def __init__(self, port: int, script: list[int | None], system_id: int = 7) -> None:
        super().__init__(0, system_id, 191, local_port=port)
        self._script = list(script)
        self.on_message = self._reply

    def _reply(self, message: Any) -> None:
        if message.get_type() == "HEARTBEAT":
            self.send(self.mav.heartbeat_encode(18, 8, 0, 0, 4))
        elif message.get_type() == "COMMAND_LONG":
            result = self._script.pop(0) if self._script else None
            if result is not None:
                self.send(self.mav.command_ack_encode(31010, result, 0, 0, 255, 190))


@pytest.fixture
def make_alight(port: int) -> Iterator[Callable[..., ScriptedAlight]]:
    made: list[ScriptedAlight] = []

    def make(*script: int | None) -> ScriptedAlight:
        made.append(ScriptedAlight(port, list(script)))
        made[-1].start()
        return made[-1]

    yield make
    for alight in made:
        alight.close()
