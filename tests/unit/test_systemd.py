"""sd_notify(3) as systemd hears it, on a socket of this test."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from app.systemd import Watchdog


class Systemd:
    def __init__(self, address: str) -> None:
        self.address = address
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self.socket.bind("\0" + address[1:] if address.startswith("@") else address)

    def heard(self) -> list[bytes]:
        words = []
        try:
            while True:
                words.append(self.socket.recv(200))
        except BlockingIOError:
            return words


@pytest.fixture(params=["path", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path):
    there = Systemd(str(tmp_path / "notify") if request.param == "path" else f"@alight-test-{os.getpid()}")
    yield there
    there.socket.close()


def test_watchdog_tells_that_the_service_is_up_and_when_it_goes_down(systemd):
    watchdog = Watchdog(systemd.address)
    watchdog.ready()
    watchdog.close()
    assert systemd.heard() == [b"READY=1", b"STOPPING=1"]


def test_watchdog_is_fed_every_tenth_turn(systemd):
    watchdog = Watchdog(systemd.address)
    for _ in range(25):
        watchdog.alive()
    assert systemd.heard() == [b"WATCHDOG=1"] * 2
    watchdog.close()


def test_watchdog_asks_for_time(systemd):
    watchdog = Watchdog(systemd.address)
    watchdog.busy(90.0)
    assert systemd.heard() == [b"EXTEND_TIMEOUT_USEC=90000000"]
    watchdog.close()


def test_watchdog_tells_that_the_service_is_stopping_before_it_asks_for_time_to_stop_in(systemd):
    watchdog = Watchdog(systemd.address)
    watchdog.stopping(30.0)
    assert systemd.heard() == [b"STOPPING=1", b"EXTEND_TIMEOUT_USEC=30000000"]
    watchdog.close()


def test_watchdog_is_silent_once_closed(systemd):
    watchdog = Watchdog(systemd.address)
    watchdog.close()
    systemd.heard()
    watchdog.ready()
    watchdog.close()
    assert systemd.heard() == []


def test_watchdog_finds_systemd_in_the_environment(systemd, monkeypatch):
    monkeypatch.setenv("NOTIFY_SOCKET", systemd.address)
    watchdog = Watchdog()
    watchdog.ready()
    assert systemd.heard() == [b"READY=1"]
    watchdog.close()


def test_watchdog_without_systemd_says_nothing_and_fails_nothing(monkeypatch):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    watchdog = Watchdog()
    watchdog.ready()
    watchdog.alive()
    watchdog.close()


def test_watchdog_whose_systemd_is_gone_fails_nothing(tmp_path):
    watchdog = Watchdog(str(tmp_path / "nobody"))
    watchdog.ready()
    watchdog.close()
