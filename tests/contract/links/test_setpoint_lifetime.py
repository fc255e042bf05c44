"""No setpoint outlives its sender: within 0.5 s of the control loop's last turn none leaves the machine (DESIGN 7).

The driver runs in a process of its own; that process is stopped, killed, or hangs by itself. The autopilot notes every
setpoint's arrival. MAVSDK's Offboard plugin would fail each of these but the kill: it sends on at 20 Hz.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

LIMIT_S = 0.5
WATCHED_S = 2.0


@pytest.fixture
def start(port: int) -> Iterator[Callable[[str], subprocess.Popen[bytes]]]:
    started: list[subprocess.Popen[bytes]] = []

    def run(how: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, str(Path(__file__).with_name("setpoint_sender.py")), str(port), how]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE))
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.communicate()


def flying(autopilot: Any) -> None:
    """Until setpoints have come at the loop's rate for half a second."""
    for _ in range(25):
        autopilot.station.wait_for("SET_POSITION_TARGET_LOCAL_NED", timeout_s=15.0)


def arrivals_s(autopilot: Any, after_s: float, before_s: float) -> list[float]:
    return [t for t, _ in autopilot.setpoints if after_s < t < before_s]


def watch(autopilot: Any, until_s: float) -> None:
    """Keep the autopilot recording until a time."""
    with pytest.raises(TimeoutError):
        autopilot.station.wait_for("never", timeout_s=until_s - time.monotonic())


@pytest.mark.parametrize("how", [signal.SIGSTOP, signal.SIGKILL])
def test_setpoints_cease_when_the_process_is_stopped_or_killed(
    autopilot: Any, start: Callable[[str], subprocess.Popen[bytes]], how: signal.Signals
) -> None:
    process = start("none")
    flying(autopilot)
    process.send_signal(how)
    end_s = time.monotonic()
    watch(autopilot, end_s + WATCHED_S)
    assert arrivals_s(autopilot, end_s - 0.5, end_s)
    assert arrivals_s(autopilot, end_s + LIMIT_S, end_s + WATCHED_S) == []


@pytest.mark.parametrize("how", ["sleep", "gil"])
def test_setpoints_cease_when_the_event_loop_or_the_interpreter_hangs(
    autopilot: Any, start: Callable[[str], subprocess.Popen[bytes]], how: str
) -> None:
    process = start(how)
    assert process.stderr is not None
    last_turn = next(m for line in process.stderr if (m := re.match(rb"last turn ([\d.]+)", line)))
    end_s = float(last_turn[1])
    watch(autopilot, end_s + WATCHED_S)
    assert arrivals_s(autopilot, end_s - 0.5, end_s)
    assert arrivals_s(autopilot, end_s + LIMIT_S, end_s + WATCHED_S) == []


def test_setpoints_of_before_a_stop_are_not_sent_after_it(
    autopilot: Any, start: Callable[[str], subprocess.Popen[bytes]]
) -> None:
    process = start("none")
    flying(autopilot)
    process.send_signal(signal.SIGSTOP)
    watch(autopilot, time.monotonic() + 1.0)
    again_s = time.monotonic()
    process.send_signal(signal.SIGCONT)
    autopilot.station.wait_for("SET_POSITION_TARGET_LOCAL_NED")
    flying(autopilot)
    ages_s = [t % 1000.0 - m.vx for t, m in autopilot.setpoints if t > again_s]
    assert max(ages_s) < LIMIT_S


def test_standard_output_stays_clean_through_a_flight(
    autopilot: Any, start: Callable[[str], subprocess.Popen[bytes]]
) -> None:
    process = start("none")
    flying(autopilot)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20.0)
    assert out == b""
    assert process.returncode not in (-signal.SIGSEGV, -signal.SIGABRT)
    assert b"mavsdk.logged" in err  # MAVSDK's own log does come, on standard error
