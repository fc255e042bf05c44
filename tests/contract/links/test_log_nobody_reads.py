"""Standard error that nobody reads (Ctrl-S, a pager, a full pipe) stops no setpoint and no answer (issue 13, item 21).

The processes are real, and so is the pipe: it is full before they start. A counter is read over another socket: the
setpoints' and the phone's.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from app.wiring import CONFIGS

PERIOD_S = 0.02
LATE_S = 0.25
"""For a busy machine; a loop that waits for its log is late for ever."""


@dataclass
class FullPipe:
    """Nobody reads it until read() is called."""

    reader: int
    writer: int
    text: bytes = b""

    def read(self, until: bytes = b"nothing that comes", *, timeout_s: float = 15.0) -> None:
        """All that comes, up to some words or a time."""
        end_s = time.monotonic() + timeout_s
        os.set_blocking(self.reader, False)
        while until not in self.text and time.monotonic() < end_s:
            with suppress(BlockingIOError):
                self.text += os.read(self.reader, 65536)
            time.sleep(0.001)

    @property
    def events(self) -> list[dict[str, Any]]:
        """What was read: JSON lines, behind what the pipe was filled with."""
        return [json.loads(line) for line in self.text.splitlines() if line]


@pytest.fixture
def full_pipe() -> Iterator[FullPipe]:
    pipe = FullPipe(*os.pipe())
    os.set_blocking(pipe.writer, False)
    with suppress(BlockingIOError):
        while True:
            os.write(pipe.writer, b"\n" * 4096)
    os.set_blocking(pipe.writer, True)
    yield pipe
    os.close(pipe.reader)
    os.close(pipe.writer)


@pytest.fixture
def start(full_pipe: FullPipe) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    started: list[subprocess.Popen[bytes]] = []

    def run(*arguments: object) -> subprocess.Popen[bytes]:
        command = [sys.executable, *map(str, arguments)]
        started.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=full_pipe.writer))
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.wait()


def periods_s(autopilot: Any, seconds: float) -> np.ndarray:
    """Between the setpoints of the next while."""
    autopilot.station.wait_for("SET_POSITION_TARGET_LOCAL_NED", timeout_s=30.0)
    start_s = time.monotonic()
    while time.monotonic() < start_s + seconds:
        autopilot.station.wait_for("SET_POSITION_TARGET_LOCAL_NED", timeout_s=2.0)
    return np.diff([t_s for t_s, _ in autopilot.setpoints if t_s > start_s])


@pytest.mark.timeout(120)
def test_flood_of_log_events_that_nobody_reads_stops_no_setpoint_and_is_told_with_its_count(
    autopilot: Any, port: int, full_pipe: FullPipe, start: Callable[..., subprocess.Popen[bytes]]
) -> None:
    process = start(Path(__file__).with_name("log_flooder.py"), port)
    periods = periods_s(autopilot, 4.0)
    assert len(periods) > 0.5 * 4.0 / PERIOD_S
    assert periods.max() < LATE_S
    full_pipe.read(b"log.lines_left_out")
    full_pipe.read(timeout_s=0.5)
    process.send_signal(signal.SIGTERM)
    full_pipe.read(timeout_s=1.0)
    assert process.wait(timeout=10.0) == 0
    events = full_pipe.events
    note = next(k for k, event in enumerate(events) if event["event"] == "log.lines_left_out")
    before, after = (
        [event["number"] for event in part if event["event"] == "line.counted"]
        for part in (events[:note], events[note + 1 :])
    )
    assert before == list(range(len(before)))
    assert after[0] == len(before) + events[note]["lines"]
    assert after == list(range(after[0], after[0] + len(after)))


@pytest.fixture
def rig(tmp_path: Path, port: int) -> tuple[Path, int]:
    """A rig file that sees grey, and the phone's port."""
    writer = cv2.VideoWriter(str(tmp_path / "grey.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (640, 480))
    for k in range(300):
        writer.write(np.full((480, 640, 3), 100 + k % 50, np.uint8))
    writer.release()
    with socket.socket(type=socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        phone = int(free.getsockname()[1])
    path = tmp_path / "rig.toml"
    path.write_text(
        f"""pad = "{CONFIGS}/pads/paper-38cm.toml"
        [camera]
        driver = "opencv"
        source = "{tmp_path}/grey.avi"
        lens = "{CONFIGS}/cameras/pi-camera3-640.toml"
        [autopilot]
        address = "udpin://127.0.0.1:{port}"
        [operator]
        address = "udpin://127.0.0.1:{phone}"
        [recorder]
        directory = ""
        """,
        encoding="utf-8",
    )
    return path, phone


@pytest.mark.timeout(120)
def test_alight_run_with_a_log_that_nobody_reads_flies_answers_and_ends(
    autopilot: Any,
    rig: tuple[Path, int],
    full_pipe: FullPipe,
    start: Callable[..., subprocess.Popen[bytes]],
    make_ground_station: Callable[..., Any],
) -> None:
    config, phone = rig
    autopilot.armed = True
    process = start("-m", "app", "run", "--config", config, "--verbose")
    station = make_ground_station()
    station.remote = ("127.0.0.1", phone)
    station.wait_for("HEARTBEAT", lambda m: m.get_srcComponent() == 191, timeout_s=30.0)
    station.command(31010, 2.0)
    station.wait_for_ack(5, timeout_s=10.0)
    periods = periods_s(autopilot, 1.0)
    assert len(periods) > 0.5 * 1.0 / PERIOD_S
    assert periods.max() < LATE_S
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=20.0) == 0
