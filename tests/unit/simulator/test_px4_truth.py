"""Following a real PX4's ground truth: fed with its messages over loopback by a clock that the test owns."""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from app.config import PadMotionConfig, WorldConfig
from app.errors import AutopilotError
from drivers.simulator import px4_truth
from drivers.simulator.px4_truth import Px4Truth
from drivers.simulator.truth_log import TruthLog
from drivers.simulator.world import Truth

LATITUDE, LONGITUDE, ALTITUDE = 47.397742, 8.545594, 488.0
METRES_A_DEGREE = math.radians(1.0) * 6371000.0
BOOT_S = 3.0
"""What PX4's clock shows when the test's shows 1000 s."""


class Px4:
    """The truth of a vehicle, as PX4's SIH sends it."""

    def __init__(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **motion: float) -> None:
        self.now_s = 1000.0
        monkeypatch.setattr(px4_truth, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        with socket.socket(type=socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.address = probe.getsockname()
        config = WorldConfig(
            vehicle="px4",
            px4_truth_address=f"udpin:127.0.0.1:{self.address[1]}",
            motion=PadMotionConfig(**motion),
        )
        self.path = tmp_path / "truth.jsonl"
        self.log = TruthLog(self.path)
        self.scene = Px4Truth(config, 30.0, self.log)
        self.scene.begin()
        self.exposed: list[tuple[float, Truth]] = []
        self.socket = socket.socket(type=socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.mav = mavlink.MAVLink(None, 7, 1)

    def expose(self, t_s: float, truth: Truth) -> None:
        self.exposed.append((t_s, truth))

    def send(
        self,
        north: float,
        height: float,
        speed: float = 0.0,
        climb: float = 0.0,
        *,
        late_s: float = 0.0,
        armed: bool = True,
    ) -> None:
        """One step of 10 ms later: PX4's time, then the truth, read late_s after they were sent."""
        self.now_s += 0.01
        mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        latitude = LATITUDE + north / METRES_A_DEGREE
        for message in (
            mavlink.MAVLink_heartbeat_message(2, 12, mode, 0, 4, 3),
            mavlink.MAVLink_hil_actuator_controls_message(
                round((self.now_s - 1000.0 + BOOT_S) * 1e6), [0.0] * 16, 0, 0
            ),
            mavlink.MAVLink_hil_state_quaternion_message(
                *(0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0),
                *(int(latitude * 1e7), int(LONGITUDE * 1e7), int((ALTITUDE + height) * 1e3)),
                *(int(speed * 100), 0, int(-climb * 100), 0, 0, 0, 0, 0),
            ),
        ):
            self.socket.sendto(message.pack(self.mav), self.address)
        self.now_s += late_s
        self.scene.advance(self)  # type: ignore[arg-type]  # a stand-in
        self.now_s -= late_s

    def close(self) -> list[dict[str, Any]]:
        self.scene.close()
        self.socket.close()
        self.log.close(self.now_s)
        return [json.loads(line) for line in self.path.read_text().splitlines()]


@pytest.fixture
def px4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Px4]:
    one = Px4(tmp_path, monkeypatch)
    yield one
    one.close()


def test_px4_truth_asks_for_the_truth_of_the_system_that_sends(px4: Px4) -> None:
    for _ in range(300):
        px4.send(0.0, 0.0)
    asked = {}
    reader = mavlink.MAVLink(None, 7, 1)
    while True:
        try:
            for message in reader.parse_buffer(px4.socket.recv(2048)) or []:
                asked[(message.target_system, int(message.param1))] = message.param2
        except BlockingIOError:
            break
    assert asked[(7, mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION)] == pytest.approx(10_000.0)


def test_px4_truth_gives_thirty_instants_a_second(px4: Px4) -> None:
    for _ in range(300):
        px4.send(0.0, 1.0)
    times = [t for t, _ in px4.exposed[5:]]
    assert (len(times) - 1) / (times[-1] - times[0]) == pytest.approx(30.0)


def test_px4_truth_of_a_fast_vehicle_is_smooth_in_spite_of_the_coarse_degrees(px4: Px4) -> None:
    for _ in range(25):
        px4.send(0.0, 0.0)
    start_s = px4.now_s
    for k in range(400):
        px4.send(3.7 * 0.01 * (k + 1), 3.0, 3.7)
    late = [(t, truth) for t, truth in px4.exposed if t > start_s + 2.0]
    errors = [truth.pos[0] - 3.7 * (t - start_s) for t, truth in late]
    mean = sum(errors) / len(errors)
    # One step of latitude is 1.1 cm; velocity comes in centimetres a second.
    assert abs(mean) < 0.015
    assert max(abs(e - mean) for e in errors) < 0.003


def test_px4_truth_that_is_read_late_keeps_its_time(px4: Px4) -> None:
    for _ in range(25):
        px4.send(0.0, 0.0)
    start_s = px4.now_s
    for k in range(300):
        px4.send(3.7 * 0.01 * (k + 1), 3.0, 3.7, late_s=0.03 if k % 7 == 3 else 0.0)
    errors = [truth.pos[0] - 3.7 * (t - start_s) for t, truth in px4.exposed if t > start_s + 2.0]
    # 30 ms late at 3.7 m/s would be 11 cm.
    assert max(errors) - min(errors) < 0.03


def test_px4_truth_stands_on_the_ground_at_the_start(px4: Px4) -> None:
    for _ in range(60):
        px4.send(0.0, 0.0)
    truth = px4.exposed[-1][1]
    assert truth.pos[2] == pytest.approx(-0.12, abs=1e-3)
    assert truth.pos[:2] == pytest.approx((0.0, 0.0), abs=1e-6)


def test_px4_truth_logs_a_touchdown_beside_a_moving_pad(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    px4 = Px4(tmp_path, monkeypatch, north_m=2.0, east_m=0.0, speed_m_s=1.0, acceleration_m_s2=10.0)
    for _ in range(40):
        px4.send(0.0, 0.0)
    for _ in range(200):
        px4.send(0.0, 1.5)
    for k in range(150):
        px4.send(0.0, 1.5 - 0.01 * (k + 1), 0.0, -1.0)
    px4.send(0.0, 0.0)
    px4.send(0.0, 0.0, armed=False)
    lines = px4.close()
    touchdown = next(line for line in lines if line["kind"] == "touchdown")
    # It set off when the vehicle passed 1 m, and drove at 1 m/s for 2 s up there and 0.5 s of the descent.
    assert touchdown["forward_m"] == pytest.approx(-(2.0 + 2.0 + 1.48), abs=0.15)
    assert touchdown["relative_speed_m_s"] == pytest.approx(1.0, abs=0.02)
    assert touchdown["sink_m_s"] == pytest.approx(1.0, abs=0.02)
    assert not touchdown["on_deck"]
    assert [line["kind"] for line in lines].count("rest") == 1


@pytest.mark.parametrize(("at_m", "drives"), [(0.0, False), (4.0, True)], ids=["far", "near"])
def test_px4_truth_pad_that_waits_for_the_vehicle_drives_off_once_it_is_near(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_m: float, drives: bool
) -> None:
    motion = {"north_m": 5.0, "east_m": 0.0, "speed_m_s": 1.0, "start_near_m": 1.5, "start_after_s": 0.5}
    px4 = Px4(tmp_path, monkeypatch, **motion)
    for _ in range(40):
        px4.send(0.0, 0.0)
    for k in range(300):
        px4.send(min(at_m, 0.04 * k), 2.0, 4.0 if 0.04 * k < at_m else 0.0)
    assert (px4.exposed[-1][1].pad.north_m > 5.0) is drives
    px4.close()


@pytest.mark.parametrize("address", ["udpout:127.0.0.1:19410", "nonsense", "udpin:127.0.0.1"])
def test_px4_truth_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(AutopilotError, match="can't be listened on"):
        Px4Truth(WorldConfig(vehicle="px4", px4_truth_address=address), 30.0, TruthLog(None))


def test_px4_truth_address_that_is_taken_is_told() -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(AutopilotError, match="in use"):
            Px4Truth(WorldConfig(vehicle="px4", px4_truth_address=address), 30.0, TruthLog(None))
