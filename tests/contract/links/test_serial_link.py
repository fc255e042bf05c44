"""The link over a serial port: a pseudo-terminal in its place, pulled out in flight and plugged in again."""

from __future__ import annotations

import asyncio
import os
import select
import socket
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import aclosing
from pathlib import Path
from typing import Any

import pytest

from app.config import AutopilotConfig
from app.messages import VehicleState
from drivers.autopilot.px4_mavsdk import Px4Autopilot


class SerialCable:
    """A pseudo-terminal under a fixed name, whose other end is joined to an autopilot's UDP socket."""

    def __init__(self, device: Path) -> None:
        self.device = device
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.port: int = self.udp.getsockname()[1]
        self._autopilot: Any = None
        self._master = -1
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def plug_in(self) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)
        self.device.unlink(missing_ok=True)
        self.device.symlink_to(os.ttyname(slave))
        os.close(slave)
        with self._lock:
            self._master = master

    def pull_out(self) -> None:
        self.device.unlink()
        with self._lock:
            os.close(self._master)
            self._master = -1

    def close(self) -> None:
        self._end.set()
        self._thread.join(timeout=5)
        self.udp.close()
        if self._master >= 0:
            os.close(self._master)

    def _run(self) -> None:
        while not self._end.is_set():
            with self._lock:
                ends: list[Any] = [self.udp] + ([self._master] if self._master >= 0 else [])
                ready, _, _ = select.select(ends, [], [], 0.002)
                try:
                    if self.udp in ready:
                        data, self._autopilot = self.udp.recvfrom(4096)
                        if self._master >= 0:
                            os.write(self._master, data)
                    if self._master in ready and self._autopilot is not None:
                        self.udp.sendto(os.read(self._master, 4096), self._autopilot)
                except OSError:
                    continue  # nobody has opened the other end yet
            self._end.wait(0.0005)


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[SerialCable]:
    cable = SerialCable(tmp_path / "ttyPX4")
    try:
        cable.plug_in()
    except OSError as fault:  # a bare container may have no devpts
        cable.close()
        pytest.skip(f"no pseudo-terminal can be opened on this machine ({fault.strerror})")
    yield cable
    cable.close()


@pytest.fixture
def port(cable: SerialCable) -> int:
    return cable.port


async def state_where(link: Px4Autopilot, accept: Callable[[VehicleState], bool], timeout_s: float) -> VehicleState:
    async with asyncio.timeout(timeout_s), aclosing(link.states()) as states:
        async for state in states:
            if accept(state):
                return state
    raise AssertionError("the states ended")


async def test_serial_port_pulled_out_and_plugged_in_again_is_opened_again(autopilot: Any, cable: SerialCable) -> None:
    config = AutopilotConfig(address=f"serial://{cable.device}:921600", connect_timeout_s=10.0)
    async with Px4Autopilot(config) as link:
        flying = await state_where(link, lambda s: s.local_position_ok, 5.0)
        cable.pull_out()
        await state_where(link, lambda s: not s.connected, 5.0)
        cable.plug_in()
        again = await state_where(link, lambda s: s.connected and s.local_position_ok, 15.0)
        assert again.t_capture_s > flying.t_capture_s
